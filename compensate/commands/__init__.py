"""Subcommands of `domesim` that compensate and predict."""
