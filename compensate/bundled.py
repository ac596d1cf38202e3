"""The master that comes with the program: a night sky over a city."""

from __future__ import annotations

from importlib import resources

from domesim.frames import Master, read_master


def bundled_night() -> Master:
    """Reads the bundled night, a domemaster."""
    with resources.as_file(resources.files("scenes") / "masters" / "night.exr") as path:
        return read_master([path])
