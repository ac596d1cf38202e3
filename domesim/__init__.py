"""What light does in a theatre: projector, screen, pollution and what the audience sees."""
