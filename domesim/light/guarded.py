"""Guards of public functions, by what their parameters are said to be.

A `guarded` function looks at its arguments before it begins. It refuses by an `InputError` what is
not of a parameter's kind, or has not its axes. It never returns what is not a number in silence. It
refuses arguments that are not finite if its result could not show it. Errors that come from within
are its own faults, and stay what they are. Functions that it calls are not guarded again.

    Light                    float32 or float64, (view, row, col, primary)
    Floats, Planes, ...      float32 or float64, any axes
    ArrayLike                what NumPy makes real numbers of
    Mask, NDArray[np.bool_]  bool
    float, int               a number
    a class                  one of it, or of its subclasses

Axes are told by their names, ``guarded(light="row col primary", weights="primary")``: a name has
one size everywhere, which is not 0, and a number is a size. ``...`` is any axes, none empty.
``*s`` is any axes, too, and those of one name go together as NumPy broadcasts them. What ends in
``, finite`` is refused at once if it is not.
"""

from __future__ import annotations

import inspect
import numbers
import types
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextvars import ContextVar
from functools import cache, wraps
from typing import Any, ParamSpec, TypeVar, overload

import numpy as np

from domesim.errors import InputError
from domesim.light import require_light

P = ParamSpec("P")
R = TypeVar("R")

_inside = ContextVar("inside", default=False)


@overload
def guarded(function: Callable[P, R], /) -> Callable[P, R]: ...


@overload
def guarded(**axes: str) -> Callable[[Callable[P, R]], Callable[P, R]]: ...


def guarded(function: Any = None, /, **axes: str) -> Any:
    """Makes a function refuse what it cannot take, by the module's table.

    Parameters
    ----------
    function
        A public function with annotations.
    axes
        Names of the axes of its arrays.

    Returns
    -------
    function
        The same one, guarded. It raises `InputError` also where the result has values that are not
        a number.
    """
    if function is None:
        return lambda each: _guarded(each, axes)
    return _guarded(function, {})


def _guarded(function: Callable[P, R], axes: Mapping[str, str]) -> Callable[P, R]:
    signature = inspect.signature(function)
    kinds = {
        name: [each.strip() for each in str(parameter.annotation).split("|")]
        for name, parameter in signature.parameters.items()
    }
    checks = {name: CHECKS[first] for name, (first, *_) in kinds.items() if first in CHECKS}
    optional = {name for name, (_, *others) in kinds.items() if others == ["None"]}
    checks = {name: each for name, each in checks.items() if kinds[name][1:] in ([], ["None"])}

    @cache
    def classes() -> dict[str, tuple[type, ...]]:
        """Classes of the other parameters; at the first call, when all have been defined."""
        several = inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD
        found = {
            name: _classes(each.annotation, function)
            for name, each in signature.parameters.items()
            if name not in checks and each.kind not in several
        }
        return {name: each for name, each in found.items() if each}

    @wraps(function)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        if _inside.get():
            return function(*args, **kwargs)
        who, given = function.__name__, signature.bind(*args, **kwargs).arguments
        arrays = {
            name: given[name]
            for name in checks
            if name in given and not (name in optional and given[name] is None)
        }
        for name, value in arrays.items():
            checks[name](f"{who}'s {name}", value)
        for name, wanted in classes().items():
            if name in given and not isinstance(given[name], wanted):
                what = " or ".join(each.__name__ for each in wanted if each is not types.NoneType)
                raise InputError(f"{who}'s {name} takes a {what}, got {_briefly(given[name])}")
        _fit(who, axes, arrays)
        token = _inside.set(True)
        try:
            with np.errstate(all="ignore"):  # what comes of it is looked at below
                result = function(*args, **kwargs)
        finally:
            _inside.reset(token)
        found = list(_arrays(result))
        if any(_lacks(each, np.isnan) for each in found):
            raise InputError(f"{who} has no number for {_told(given)}")
        if not any(each.dtype.kind == "f" for each in found):
            for name, value in arrays.items():
                for each in _arrays(value):
                    _refuse_infinite(f"{who}'s {name}", each)
        return result

    return checked


def _classes(annotation: Any, function: Callable[..., Any]) -> tuple[type, ...]:
    """Classes that an annotation names; none if it names anything else, or what is not imported."""
    try:
        named = eval(annotation, function.__globals__)
    except (NameError, TypeError):  # TypeError: a union with a forward reference
        return ()
    union = isinstance(named, types.UnionType) or typing.get_origin(named) is typing.Union
    parts = typing.get_args(named) if union else (named,)
    found = tuple(typing.get_origin(each) or each for each in parts)
    if not all(inspect.isclass(each) and not _is_for_checkers(each) for each in found):
        return ()
    return (*found, numbers.Real) if float in found else found


def _is_for_checkers(kind: Any) -> bool:
    """Whether a class is one for type checkers alone."""
    return kind is Any or getattr(kind, "_is_protocol", False)


def _fit(who: str, axes: Mapping[str, str], given: Mapping[str, Any]) -> None:
    """Refuse arrays whose axes are not those, or that do not go together."""
    sizes: dict[str, Any] = {}
    for name, wanted in axes.items():
        if name not in given:
            continue
        shape, (names, finite, _) = np.shape(given[name]), wanted.partition(", finite")
        if finite:
            _refuse_infinite(f"{who}'s {name}", np.asarray(given[name]))
        if not _fits(shape, names.split(), sizes):
            known = ", ".join(f"{axis} = {size}" for axis, size in sizes.items())
            beside = f", where {known}" if len(axes) > 1 and known else ""
            raise InputError(f"{who}'s {name} takes the axes ({names}), got {shape}{beside}")


def _fits(shape: tuple[int, ...], names: Sequence[str], sizes: dict[str, Any]) -> bool:
    """Whether a shape has the axes of those names and `sizes`; notes the sizes of new names."""
    at = next((k for k, name in enumerate(names) if name[0] in ".*"), len(names))
    before, any_, after = names[:at], names[at : at + 1], names[at + 1 :]
    end = len(shape) - len(after) if any_ else at
    if end < at or (not any_ and len(shape) != at):
        return False
    for name, size in zip([*before, *after], [*shape[:at], *shape[end:]], strict=True):
        right = int(name) if name.isdigit() else sizes.setdefault(name, size)
        if size != right or size == 0:
            return False
    if not any_ or any_ == ["..."]:
        return 0 not in shape
    try:
        sizes[any_[0]] = np.broadcast_shapes(sizes.get(any_[0], ()), shape[at:end])
    except ValueError:
        return False
    return True


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
    _refuse_infinite(who, np.asarray(value))


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


def _refuse_infinite(who: str, array: np.ndarray[Any, Any]) -> None:
    if _lacks(array, _not_finite):
        raise InputError(f"{who} must be finite, got {_briefly(array)}")


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
