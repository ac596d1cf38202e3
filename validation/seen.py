"""Plain figures of what is seen against the master: ratios and distances, without a vision model.

The judges of `panel` are models. These figures say in plain units what a picture keeps: light,
colour, structure and black. Those that the product tells are `compensate.plain`'s: contrast is
there, and structure here is a difference of luminances. All take Light (view, row, col, primary),
1.0 = projector white: the master, which should be seen, and what is seen. Only pixels on the screen
count. A figure is None where the master holds nothing that it could be measured on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, maximum_filter1d

from compensate.plain import Colours, of_colours
from domesim.light import Light, require_light
from domesim.scene import Scene
from validation.judges import luminance

BANDS = ((0.25, 1.0), (2.0, 10.0), (10.0, 30.0))
"""(fine, coarse) sigmas of the bands of structure, degrees: texture, the Milky Way, glows."""
FAINT = 0.8
"""Share of the screen, the darker one, in which structure is looked for."""
DARKEST = 1e-4
"""Luminance, white = 1, below which nobody sees a hue."""
VISIBLE_CHROMA = 0.01
"""Distance in CIE 1976 u'v' beyond which a colour counts as shifted."""
EXACT = 1e-5
"""Difference from the master that counts as none, of white."""
NOT_BLACK = 0.02
"""Luminance above which light that is exact must be kept, cd/m²."""

HALO_SIGMAS = (1.0, 6.0)
"""Sigmas of the base contrast, degrees. The second is also how far a halo reaches."""
HALO_BLACK = 0.02
"""Luminance that darker pixels are raised to before the logarithm, cd/m²."""
HALO_CONTRAST = 0.1
"""Base contrast that both pictures must exceed, log10 units (26 %)."""
HALO_BRIGHTER = 5.0
"""Ratio of a bright thing's luminance to that of what lies beside it."""

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


def structure_seen(
    master: Light, seen: Light, scene: Scene, low_deg: float, high_deg: float
) -> float | None:
    """Share of the master's structure of some size that is seen in its darker `FAINT`.

    Structure is the difference of two local means of luminance, which count only pixels of the
    darker region. The figure is the projection of what is seen on the master's: 1 is as in the
    master, 0 is lost, below 0 is reversed. An even veil does not change it.

    Parameters
    ----------
    master, seen
        (view, row, col, primary).
    scene
        Where.
    low_deg, high_deg
        Sigmas of the finer and the coarser mean, degrees; see `BANDS`.

    Raises
    ------
    ValueError
        If the pictures have not the same shape, or `low_deg` is not below `high_deg`.
    """
    _require_pair("structure_seen", master, seen)
    if not 0 < low_deg < high_deg:
        raise ValueError(
            f"structure_seen takes 0 < low_deg < high_deg, got {low_deg:g} and {high_deg:g}"
        )
    screen = scene.screen(*master.shape[1:3])
    sigmas = [sigma * _density(master, scene) for sigma in (low_deg, high_deg)]
    product = power = 0.0
    for wanted, shown in _each_view(master, seen, scene):
        faint = screen & (wanted < np.quantile(wanted[screen], FAINT))
        of_master, of_seen = (_band(plane, faint, sigmas)[faint] for plane in (wanted, shown))
        product += float(of_seen @ of_master)
        power += float(of_master @ of_master)
    return product / power if power > 0 else None


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
    return of_colours(wanted, shown, scene.projector.luminance_weights)


def halos(master: Light, seen: Light, scene: Scene) -> float:
    """Share of the screen's area where the base contrast is reversed beside bright things.

    Base contrast is log10 luminance, at least `HALO_BLACK`, averaged over the first of
    `HALO_SIGMAS` minus that averaged over the second. A halo is where its sign is not the master's
    and both contrasts exceed `HALO_CONTRAST`. It must lie within 6 degrees of something that is
    `HALO_BRIGHTER` times as bright in the master, averaged over 1 degree, as the master is there.

    Parameters
    ----------
    master, seen
        (view, row, col, primary). The share is the mean of the views'.
    scene
        Where.

    Raises
    ------
    ValueError
        If the pictures have not the same shape.
    """
    _require_pair("halos", master, seen)
    rows, cols = master.shape[1:3]
    screen, areas = scene.screen(rows, cols), scene.pixel_areas(rows, cols)
    density = _density(master, scene)
    sigmas = [sigma * density for sigma in HALO_SIGMAS]
    shares = []
    for pair in _each_view(master, seen, scene):
        raised = [np.maximum(plane * scene.projector.white, HALO_BLACK) for plane in pair]
        wanted, shown = (_band(np.log10(plane), screen, sigmas) for plane in raised)
        weaker = np.minimum(np.abs(wanted), np.abs(shown))
        turned_over = (wanted * shown < 0) & (weaker > HALO_CONTRAST)
        smooth = np.where(screen, mean_within(raised[0], screen, sigmas[0]), 0)
        beside = _highest_within(smooth, sigmas[1]) > HALO_BRIGHTER * smooth
        shares.append(float(np.sum(areas * (turned_over & beside & screen)) / areas.sum()))
    return float(np.mean(shares))


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


def _density(light: Light, scene: Scene) -> float:
    """Pixels per degree."""
    return scene.viewing.pixels_per_degree(*light.shape[1:3])


def _each_view(master: Light, seen: Light, scene: Scene) -> list[tuple[Floats, Floats]]:
    """(row, col) luminances of master and seen, view by view."""
    return list(zip(luminance(master, scene), luminance(seen, scene), strict=True))


def _band(plane: Floats, where: Mask, sigmas: list[float]) -> Floats:
    """Difference of the local means of two sizes."""
    fine, coarse = (mean_within(plane, where, sigma) for sigma in sigmas)
    return fine - coarse


def mean_within(plane: Floats, where: Mask, sigma: float) -> Floats:
    """Local mean over the pixels `where`; 1 far from any of them."""
    share = gaussian_filter(where.astype(np.float64), sigma)
    total = gaussian_filter(np.where(where, plane, 0), sigma)
    return np.asarray(np.divide(total, share, out=np.ones_like(total), where=share > 1e-9))


def _highest_within(plane: Floats, radius: float) -> Floats:
    """Highest value within a disc, which takes one filter for each of its rows."""
    highest, rows, reach = plane.copy(), len(plane), int(radius)
    for step in range(min(reach, rows - 1) + 1):
        width = 2 * int(np.sqrt(radius**2 - step**2)) + 1
        row = maximum_filter1d(plane, width, axis=1)
        below, above = slice(step, rows), slice(rows - step)
        np.maximum(highest[below], row[above], out=highest[below])
        np.maximum(highest[above], row[below], out=highest[above])
    return highest
