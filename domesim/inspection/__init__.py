"""What a scene comes to before any work: coverage, brightness, contrast, plans to scale."""
