"""What to project, so that what the audience sees is as close as can be to the master.

The names below load their module when they are first used: ``import compensate`` loads nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from compensate.master import compensate, predict

__all__ = ["compensate", "predict"]

if not TYPE_CHECKING:  # mypy would take any name for it

    def __getattr__(name):
        """Load what has that name."""
        from importlib import import_module  # noqa: PLC0415

        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module("compensate.master"), name)
