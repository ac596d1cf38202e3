"""Models of human vision, each a file, each with its published source."""
