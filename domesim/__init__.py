"""What light does in a theatre: projector, screen, pollution and what the audience sees."""

from __future__ import annotations

from typing import Any

__all__ = ["__version__"]

__version__: str


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version  # noqa: PLC0415 - takes 30 ms

        return version("domesim")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
