"""Plain figures of what is seen against the master: ratios and distances, without a vision model.

The judges of `panel` are models. These figures say in plain units what a picture keeps: light,
colour and black. Those that the product tells, contrast among them, are `compensate.plain`'s. All
take Light (view, row, col, primary),
1.0 = projector white: the master, which should be seen, and what is seen. Only pixels on the screen
count. A figure is None where the master holds nothing that it could be measured on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from compensate.plain import Colours, of_colours
from domesim.light import Light, require_light
from domesim.scene import Scene
from validation.judges import luminance

DARKEST = 1e-4
"""Luminance, white = 1, below which nobody sees a hue."""
VISIBLE_CHROMA = 0.01
"""Distance in CIE 1976 u'v' beyond which a colour counts as shifted."""
EXACT = 1e-5
"""Difference from the master that counts as none, of white."""
NOT_BLACK = 0.02
"""Luminance above which light that is exact must be kept, cd/m²."""

Floats = NDArray[np.floating[Any]]
Mask = NDArray[np.bool_]


@final
@dataclass(frozen=True)
class LightKept:
    """Ratio of luminance seen to the master's.

    Attributes
    ----------
    median, fifth
        Its median and its 5th percentile over the pixels.
    """

    median: float
    fifth: float


def light_kept(master: Light, seen: Light, where: Mask, scene: Scene) -> LightKept | None:
    """Median and 5th percentile of the ratio of luminances.

    Parameters
    ----------
    master, seen
        (view, row, col, primary).
    where
        (row, col) or (view, row, col) pixels that count. Those where the master is black do not.
    scene
        Where.

    Raises
    ------
    ValueError
        If the pictures have not the same shape.
    """
    _require_pair("light_kept", master, seen)
    wanted, shown = luminance(master, scene), luminance(seen, scene)
    counted = _on_screen(where, master, scene) & (wanted > 0)
    if not counted.any():
        return None
    fifth, median = np.percentile(shown[counted] / wanted[counted], [5, 50])
    return LightKept(float(median), float(fifth))


def chroma_shift(master: Light, seen: Light, where: Mask, scene: Scene) -> float | None:
    """Share of pixels whose CIE 1976 u'v' lies more than `VISIBLE_CHROMA` from the master's.

    Parameters
    ----------
    master, seen
        (view, row, col, primary).
    where
        (row, col) or (view, row, col) pixels that count. Those below `DARKEST` in either
        picture have no colour and do not count.
    scene
        Where.

    Raises
    ------
    ValueError
        If the pictures have not the same shape.
    """
    _require_pair("chroma_shift", master, seen)
    counted = _on_screen(where, master, scene)
    for light in (master, seen):
        counted &= luminance(light, scene) > DARKEST
    if not counted.any():
        return None
    to_xyz = scene.projector.to_xyz.T
    wanted, shown = (chromaticity(light[counted] @ to_xyz) for light in (master, seen))
    return float(np.mean(np.abs(shown - wanted) > VISIBLE_CHROMA))


def saturation_and_hue(master: Light, seen: Light, scene: Scene) -> Colours | None:
    """Hue shift and saturation of the master's darker half.

    Colours are (R - Y) / Y and (B - Y) / Y of the projector's R and B and the luminance Y. Pixels
    count by the master's luminance times saturation.

    Parameters
    ----------
    master, seen
        (view, row, col, primary). The darker half of each view is below its median luminance.
    scene
        Where.

    Returns
    -------
    Colours | None
        None if the darker half of the master is grey or black.

    Raises
    ------
    ValueError
        If the pictures have not the same shape.
    """
    _require_pair("saturation_and_hue", master, seen)
    screen = scene.screen(*master.shape[1:3])
    pixels = []
    for view, wanted in enumerate(luminance(master, scene)):
        dark = screen & (wanted < np.median(wanted[screen]))
        pixels.append([light[view][dark] for light in (master, seen)])
    wanted, shown = (np.concatenate(each) for each in zip(*pixels, strict=True))
    if not len(wanted):  # all of the master is as dark as its median
        return None
    return of_colours(wanted, shown, scene.projector.luminance_weights)


def black_level(seen: Light, scene: Scene) -> float:
    """1st percentile of the luminance (view, row, col, primary) on the screen, cd/m²."""
    require_light(seen, who="black_level")
    on_screen = luminance(seen, scene)[:, scene.screen(*seen.shape[1:3])]
    return float(np.percentile(on_screen, 1) * scene.projector.white)


def exact(master: Light, seen: Light, scene: Scene) -> Mask:
    """(view, row, col) pixels of the screen that are seen as in the master, and are not black.

    Parameters
    ----------
    master, seen
        (view, row, col, primary), 1 = projector white.
    scene
        Where they are seen.
    """
    near = np.all(np.abs(seen - master) <= EXACT, axis=-1)
    bright = luminance(master, scene) * scene.projector.white > NOT_BLACK
    return _on_screen(near & bright, master, scene)


def chromaticity(xyz: NDArray[Any]) -> NDArray[np.complex128]:
    """Complex u' + i v' (CIE 15:2004, section 8.2.1) of colours (..., XYZ) that are not black."""
    x, y, z = np.moveaxis(xyz, -1, 0)
    return np.asarray((4 * x + 9j * y) / (x + 15 * y + 3 * z))


def _require_pair(who: str, master: Light, seen: Light) -> None:
    require_light(master, who=who)
    require_light(seen, master.shape, who=who)


def _on_screen(where: Mask, light: Light, scene: Scene) -> Mask:
    """(view, row, col) pixels of `where` that lie on the screen."""
    return np.array(np.broadcast_to(where & scene.screen(*light.shape[1:3]), light.shape[:3]))


def mean_within(plane: Floats, where: Mask, sigma: float) -> Floats:
    """Local mean over the pixels `where`; 1 far from any of them."""
    share = gaussian_filter(where.astype(np.float64), sigma)
    total = gaussian_filter(np.where(where, plane, 0), sigma)
    return np.asarray(np.divide(total, share, out=np.ones_like(total), where=share > 1e-9))
