"""What to project, so that what the audience sees is as close as can be to the master."""
