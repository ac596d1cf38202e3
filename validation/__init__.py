"""What may be believed, shown by experiments and benchmarks that anyone can rerun.

The names below load their modules when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from validation.entry import enter
    from validation.panel import judge

__all__ = ["enter", "judge"]

if not TYPE_CHECKING:  # mypy would take any name for one of these

    def __getattr__(name):
        """Load what has that name."""
        from importlib import import_module  # noqa: PLC0415

        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        module = "validation.entry" if name == "enter" else "validation.panel"
        return getattr(import_module(module), name)
