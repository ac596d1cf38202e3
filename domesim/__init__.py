"""What light does in a theatre: projector, screen, pollution and what the audience sees.

The names below load their modules when they are first used: ``import domesim`` loads nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from domesim.library import load_master, observe, render, save, tabulate
    from domesim.scene import load_scene

    __version__: str

__all__ = ["__version__", "load_master", "load_scene", "observe", "render", "save", "tabulate"]

if not TYPE_CHECKING:  # mypy would take any name for one of these

    def __getattr__(name):
        """Load what has that name."""
        from importlib import import_module, metadata  # noqa: PLC0415

        if name == "__version__":
            return metadata.version("domesim")
        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        module = "domesim.scene" if name == "load_scene" else "domesim.library"
        return getattr(import_module(module), name)
