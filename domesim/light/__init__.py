"""Light: the one array that travels through the house.

``Light`` is an array of the `array API standard <https://data-apis.org/array-api/>`_ (NumPy,
PyTorch) in float32 or float64 with axes **(view, row, col, primary)**. It is linear, and 1.0
is projector white. A dome has one view, a stereo pair has two: left, right. A primary is a
projector primary (R, G, B).
"""

from __future__ import annotations

from typing import Any, Protocol, TypeAlias, TypeVar

import numpy as np
from array_api_compat import array_namespace, is_torch_array, to_device
from numpy.typing import NDArray

from domesim.errors import InputError

Array: TypeAlias = Any
"""Any array of the array API standard: the standard has no static type yet."""

Light: TypeAlias = Array
"""(view, row, col, primary), linear, 1.0 = projector white."""


class LightArray(Protocol):
    """What public functions take as `Light`: any array of the standard, and nothing else."""

    @property
    def shape(self) -> tuple[Any, ...]:
        """Sizes of the axes."""

    @property
    def dtype(self) -> Any:
        """Precision."""

    @property
    def device(self) -> Any:
        """Where it is."""


LightT = TypeVar("LightT", bound=LightArray)

AXES = ("view", "row", "col", "primary")


def namespace(*arrays: Array) -> Any:
    """The array API namespace (``xp``) of `arrays`.

    NumPy is its own: `array_api_compat.numpy` loads a hundred modules that nobody asks for.
    """
    if all(isinstance(each, np.ndarray | np.generic) for each in arrays):
        return np
    return array_namespace(*arrays)


def on_host(array: Array) -> NDArray[Any]:
    """Returns `array` as a NumPy array, fetched from its device."""
    if is_torch_array(array):
        array = to_device(array.detach(), "cpu")
    return np.asarray(array)


def as_sent(array: NDArray[Any], sent: Array) -> Array:
    """Converts a NumPy array to the library, precision and device of another.

    Parameters
    ----------
    array
        Of any shape.
    sent
        An array of any library.

    Returns
    -------
    array
        The same values.
    """
    return namespace(sent).asarray(array, dtype=sent.dtype, device=sent.device)


def require_light(
    light: Light,
    shape: tuple[int, ...] | None = None,
    *,
    who: str,
    primaries: int | None = None,
) -> None:
    """Refuse what is not Light.

    Parameters
    ----------
    light
        What must be floating and have axes (view, row, col, primary).
    shape
        The sizes that it must have; any if None.
    who
        Name of the caller, for the message.
    primaries
        How many it must have; any if None.

    Raises
    ------
    InputError
        If it is not a real floating array with four axes, or has another shape.
    """
    if not hasattr(light, "shape"):
        raise InputError(
            f"{who} takes an array (view, row, col, primary), got a {type(light).__name__}"
        )
    sizes = tuple(light.shape)
    if shape is not None and sizes != shape:
        raise InputError(f"{who} takes (view, row, col, primary) = {shape}, got {sizes}")
    if len(sizes) != len(AXES):
        raise InputError(f"{who} takes axes (view, row, col, primary), got shape {sizes}")
    if primaries not in (None, sizes[-1]):
        raise InputError(f"{who} takes light of {primaries} primaries, got {sizes[-1]}")
    xp = namespace(light)
    if light.dtype not in (xp.float32, xp.float64):
        raise InputError(f"{who} takes float32 or float64 light, got {light.dtype}")


def require_finite(light: Light, *, who: str) -> None:
    """Refuse light that is not a number somewhere: it would spread over all that is seen.

    Parameters
    ----------
    light
        Of any axes.
    who
        Name of the caller, for the message.

    Raises
    ------
    InputError
        If a value is NaN or infinite.
    """
    xp = namespace(light)
    if not bool(xp.isfinite(xp.sum(light, dtype=xp.float64))):
        count = int(xp.sum(xp.astype(~xp.isfinite(light), xp.int64)))
        raise InputError(
            f"{who} takes finite light, got {count} values that are NaN or infinite. "
            f"Replace them first."
        )


def require_mask(mask: NDArray[np.bool_], *, who: str) -> None:
    """Refuse what is no mask of pixels that count, or one of no pixels.

    Parameters
    ----------
    mask
        (row, col) bool.
    who
        Name of the caller, for the message.

    Raises
    ------
    InputError
        If it is no NumPy array of bool with two axes, or none of it is true.
    """
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.ndim != 2:
        got = f"{mask.dtype} {mask.shape}" if isinstance(mask, np.ndarray) else type(mask).__name__
        raise InputError(f"{who} takes a screen of (row, col) bool, got {got}")
    if not mask.any():
        raise InputError(f"{who} takes a screen of which some pixels count, got none")


def kind(array: Array) -> tuple[str, str, str]:
    """Returns library, precision and device of `array`: the key of converted constants."""
    return namespace(array).__name__, str(array.dtype), str(array.device)


def total(values: Array) -> Array:
    """Sum of all values in float64: in float32 a 4096² frame would lose the adjoint's last digits.

    Returns a 0-dimensional array, which stays on its device.
    """
    xp = namespace(values)
    return xp.sum(values, dtype=xp.float64)


def dot(left: Array, right: Array) -> float:
    """Inner product <left, right>, summed in float64.

    Parameters
    ----------
    left, right
        Arrays of one shape.

    Returns
    -------
    product
        The sum of their products.
    """
    return float(total(left * right))
