"""The one error for input that cannot be used.

Its message is one line: who found it, what was wanted, what came, and the way out. Libraries
raise it; only the command line prints it (and exits with 2).
"""

import math


class InputError(ValueError):
    """Something the user gave (a file, a field, an option) cannot be used."""


class HopelessError(InputError):
    """What would go wrong with every other frame of a show, too."""


class PairError(InputError):
    """Left and right that are no pair."""


class NoPlaceError(HopelessError):
    """A result cannot be put where it belongs; nor can the next: the disk is full, say."""


def require_positive(what: str, **settings: float) -> None:
    """Refuse settings that are not above 0, or not finite.

    Parameters
    ----------
    what
        What they are settings of, for the message.
    **settings
        Numbers by name.

    Raises
    ------
    InputError
        If one is not.
    """
    for name, value in settings.items():
        if not 0 < value < math.inf:
            raise InputError(f"the {name} of {what} must be above 0, got {value:g}")


def require_not_negative(what: str, **settings: float) -> None:
    """Refuse settings that are below 0, or not finite.

    Parameters
    ----------
    what, **settings
        As for `require_positive`.

    Raises
    ------
    InputError
        If one is.
    """
    for name, value in settings.items():
        if not 0 <= value < math.inf:
            raise InputError(f"the {name} of {what} must be at least 0, got {value:g}")


def reason(error: OSError) -> str:
    """What the operating system complains of."""
    return (error.strerror or str(error)).lower()
