"""What an ICC profile says: transfer function and primaries, as LittleCMS evaluates it.

A profile's name is no evidence: "GIMP built-in Linear sRGB" is linear. Its primaries are compared
in XYZ, adapted to D50 as profiles have them (ICC.1:2022, annex E); greys in L*, which LittleCMS
gives 8 bits of: the curves differ by 4 of its codes or more.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from domesim.frames.messages import one_line
from domesim.light import transfer

CURVES = ("linear", "srgb", "gamma2.2", "gamma2.4", "gamma2.6")
_D50 = np.array([0.9642, 1.0, 0.8249])
_BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)
_NEAR = 0.004  # of XYZ: profiles round, and take white points of four digits
_CODES = 1.5  # of L*, 8 bits


def meaning_of(
    profile: bytes, chromaticities: Mapping[str, tuple[float, ...]]
) -> tuple[str, str | tuple[float, ...]]:
    """Transfer and primaries of an ICC profile: of `CURVES`, and the name of those given by name.

    Primaries that have no name are x, y of red, green, blue and white, as they are adapted to D50.

    Raises
    ------
    ValueError
        If it is none of these. The message says what was got.
    """
    from PIL import ImageCms  # noqa: PLC0415 - most files have no profile

    try:
        opened = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        name = one_line(opened.profile.profile_description or "")
        if opened.profile.xcolor_space.strip() != "RGB":
            raise ValueError(f"ICC profile '{name}', which is not of R, G, B")
        lightness = _lightness(opened)
    except (ImageCms.PyCMSError, OSError, AttributeError) as error:
        raise ValueError("an ICC profile that does not read") from error
    curve = _near(lightness)
    if curve is None:
        raise ValueError(f"ICC profile '{name}' with another tone curve")
    tags = [getattr(opened.profile, f"{primary}_primary") for primary in ("red", "green", "blue")]
    if None in tags:
        raise ValueError(f"ICC profile '{name}' without primaries")
    columns = np.array([xyz for xyz, _ in tags]).T
    for primaries, xy in chromaticities.items():
        if np.abs(columns - _adapted(xy)).max() <= _NEAR:
            return curve, primaries
    xy = np.column_stack([columns, _D50])[:2] / np.column_stack([columns, _D50]).sum(axis=0)
    return curve, tuple(xy.T.ravel().tolist())


def curve_of(light: NDArray[np.float64]) -> str | None:
    """Which of `CURVES` a table (256,) of light is, from 0 to 1; None if it is another."""
    return _near(_seen(light))


def _near(lightness: NDArray[np.float64]) -> str | None:
    """The curve whose greys have that lightness."""
    expected = {
        curve: _seen(transfer.named(curve, white=100.0).decode(np.arange(256) / 255))
        for curve in CURVES
    }
    near = (name for name, each in expected.items() if np.abs(lightness - each).max() <= _CODES)
    return next(near, None)


def _lightness(profile: Any) -> NDArray[np.float64]:
    """(256,) L* of greys, 255 for 100; or far off if they are not grey."""
    from PIL import Image, ImageCms  # noqa: PLC0415

    lab = ImageCms.createProfile("LAB")
    # Optimised, it would look up a few points only, and miss a linear curve by 20 codes.
    relative, exact = ImageCms.Intent.RELATIVE_COLORIMETRIC, ImageCms.Flags.NOOPTIMIZE
    transform = ImageCms.buildTransform(profile, lab, "RGB", "LAB", relative, exact)
    greys = np.repeat(np.arange(256, dtype=np.uint8)[None, :, None], 3, axis=2)
    converted = np.asarray(ImageCms.applyTransform(Image.fromarray(greys), transform))[0]
    tint = np.abs(converted[:, 1:].view(np.int8)).max()
    return converted[:, 0].astype(np.float64) if tint <= 2 else np.full(256, -np.inf)


def _seen(light: NDArray[Any]) -> NDArray[np.float64]:
    """L* of light (CIE 15:2018, 8.2.1), as `_lightness` gives it."""
    small = (24 / 116) ** 3
    root = np.where(light > small, np.cbrt(light), light * (841 / 108) + 16 / 116)
    return np.asarray((116 * root - 16) * 2.55)


def _adapted(xy: tuple[float, ...]) -> NDArray[np.float64]:
    """(XYZ, primary) of light 1 of each primary, its white adapted to D50."""
    x, y = np.array(xy[:6:2]), np.array(xy[1:6:2])
    shape = np.array([x, y, 1 - x - y])
    white = np.array([xy[6] / xy[7], 1.0, (1 - xy[6] - xy[7]) / xy[7]])
    matrix = shape * np.linalg.solve(shape, white)
    cones = np.diag(_BRADFORD @ _D50 / (_BRADFORD @ white))
    return np.asarray(np.linalg.inv(_BRADFORD) @ cones @ _BRADFORD @ matrix)
