"""Guards of public functions, by what their parameters are said to be.

A `guarded` function takes what its annotations say, refuses all else by an `InputError`, and never
returns what is not a number in silence. What it checks itself comes first. Functions that it calls
are not guarded again.

    Light                    float32 or float64, (view, row, col, primary)
    Floats, Planes, ...      float32 or float64, any axes
    ArrayLike                what NumPy makes real numbers of
    Mask, NDArray[np.bool_]  bool
    float, int               a finite number
"""

from __future__ import annotations

import inspect
import numbers
from collections.abc import Callable, Iterable, Mapping
from contextvars import ContextVar
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import numpy as np

from domesim.errors import InputError
from domesim.light import require_light

P = ParamSpec("P")
R = TypeVar("R")

_inside = ContextVar("inside", default=False)


def guarded(function: Callable[P, R]) -> Callable[P, R]:
    """Makes a function refuse what it cannot take, by the module's table.

    Parameters
    ----------
    function
        A public function with annotations.

    Returns
    -------
    function
        The same one, guarded. It raises `InputError` also where arguments do not fit together, or
        the result has values that are not a number.
    """
    signature = inspect.signature(function)
    checks: dict[str, Callable[[str, Any], None]] = {}
    optional = set()
    for name, parameter in signature.parameters.items():
        first, *others = (each.strip() for each in str(parameter.annotation).split("|"))
        if first in CHECKS and others in ([], ["None"]):
            checks[name] = CHECKS[first]
            optional |= {name} if others else set()

    @wraps(function)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        if _inside.get():
            return function(*args, **kwargs)
        who, given = function.__name__, signature.bind(*args, **kwargs).arguments
        for name, check in checks.items():
            if name in given and not (name in optional and given[name] is None):
                check(f"{who}'s {name}", given[name])
        token = _inside.set(True)
        try:
            with np.errstate(all="ignore"):  # what comes of it is looked at below
                result = function(*args, **kwargs)
        except InputError:
            raise
        except (ValueError, TypeError, IndexError, AttributeError, ArithmeticError) as error:
            raise InputError(f"{who} cannot take {_told(given)}: {error}") from error
        finally:
            _inside.reset(token)
        _refuse_nan(who, given, checks, result)
        return result

    return checked


def require_numbers(who: str, value: Any) -> None:
    """Refuse what is no array of finite real numbers.

    Parameters
    ----------
    who
        Name of what takes it, for the message.
    value
        Anything that NumPy makes an array of.

    Raises
    ------
    InputError
        If it is none.
    """
    _array_like(who, value)
    if _lacks(np.asarray(value), _not_finite):
        raise InputError(f"{who} must be finite, got {_briefly(np.asarray(value))}")


def _refuse_nan(who: str, given: Mapping[str, Any], names: Iterable[str], result: Any) -> None:
    """Refuse a result that is no number, or could not show that what was given is none."""
    found = list(_arrays(result))
    if any(_lacks(each, np.isnan) for each in found):
        raise InputError(f"{who} has no number for {_told(given)}")
    if any(each.dtype.kind == "f" for each in found):
        return
    for name in names:
        if any(_lacks(each, _not_finite) for each in _arrays(given.get(name))):
            raise InputError(f"{who}'s {name} must be finite, got {_briefly(given[name])}")


def _floats(who: str, value: Any) -> None:
    got = getattr(value, "dtype", type(value).__name__)
    real = isinstance(value, np.ndarray | np.generic) and got in (np.float32, np.float64)
    if not real and type(value) is not float:
        raise InputError(f"{who} takes float32 or float64, got {got}")


def _array_like(who: str, value: Any) -> None:
    try:
        array = np.asarray(value)
    except (ValueError, TypeError) as error:  # ragged lists, say
        raise InputError(f"{who} takes real numbers, got {_briefly(value)}: {error}") from None
    if array.dtype.kind not in "biuf":
        raise InputError(f"{who} takes real numbers, got {_briefly(value)}")


def _mask(who: str, value: Any) -> None:
    if not isinstance(value, np.ndarray) or value.dtype != np.bool_:
        raise InputError(f"{who} takes an array of bool, got {_briefly(value)}")


def _number(who: str, value: Any) -> None:
    real = isinstance(value, np.ndarray) and value.ndim == 0
    if not (real or isinstance(value, numbers.Real)) or isinstance(value, bool):
        raise InputError(f"{who} takes a number, got {_briefly(value)}")


CHECKS: Mapping[str, Callable[[str, Any], None]] = {
    "Light": lambda who, value: require_light(value, who=who),
    "Floats": _floats,
    "Planes": _floats,
    "NDArray[np.floating]": _floats,
    "NDArray[np.floating[Any]]": _floats,
    "NDArray[np.float64]": _floats,
    "ArrayLike": _array_like,
    "NDArray[Any]": _array_like,
    "Mask": _mask,
    "NDArray[np.bool_]": _mask,
    "float": _number,
    "int": _number,
}
"""What is asked of a parameter, by its annotation."""


def _arrays(values: Any) -> Iterable[np.ndarray[Any, Any]]:
    """Arrays and numbers among values, and within tuples, lists and objects of them."""
    if isinstance(values, np.ndarray | np.number | float):
        yield np.asarray(values)
    elif isinstance(values, tuple | list):
        for each in values:
            yield from _arrays(each)
    elif hasattr(values, "__dataclass_fields__"):
        yield from _arrays(list(vars(values).values()))


def _not_finite(array: np.ndarray[Any, Any]) -> Any:
    return ~np.isfinite(array)


def _lacks(array: np.ndarray[Any, Any], test: Callable[[np.ndarray[Any, Any]], Any]) -> bool:
    return array.dtype.kind == "f" and bool(np.any(test(array)))


def _told(given: Mapping[str, Any]) -> str:
    """Arguments in a few words."""
    return ", ".join(f"{name} = {_briefly(value)}" for name, value in given.items())


def _briefly(value: Any) -> str:
    if isinstance(value, np.ndarray):
        beyond = int(np.count_nonzero(_not_finite(value))) if value.dtype.kind == "f" else 0
        return f"{value.dtype} {value.shape}" + (f" with {beyond} not finite" if beyond else "")
    return f"{value!r:.40}"
