"""The one error for input that cannot be used.

Its message is one line: who found it, what was wanted, what came, and the way out. Libraries
raise it; only the command line prints it (and exits with 2).
"""


class InputError(ValueError):
    """Something the user gave (a file, a field, an option) cannot be used."""


class NoSpaceError(InputError):
    """There is no room for a result; nor is there for the next."""
