"""What is measured in a theatre: patterns to project, photographs of them, and surveys."""
