"""Subcommands that show what may be believed: bench."""
