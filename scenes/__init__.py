"""Theatres as data: ``*.toml`` scenes, and small masters rendered by the project itself."""
