"""Laws that what is seen must keep, whatever the picture: each a figure, and a bound for it.

A law is asked of five pictures: the master, what is seen of it untouched, what is seen of exact
subtraction, what is seen of a method, and the screen. No law knows how the method works. A figure
is the worst of the picture, and None where the picture has nothing that the law speaks of. `LAWS`
has them all; property tests ask them of random pictures, `quality` of all of its.

    order   of two pixels with the same surroundings the brighter is seen brighter, up to white
    bound   nothing is lifted by more than twice what its surroundings are
    stars   points have no more light than untouched, and no less than of their own
    harm    where all is polluted alike, no place is seen brighter than untouched
    dark    ... and the darker half never is
    exact   what subtraction shows exactly stays as it is
    limb    around a smooth ball light is monotone where the master's is
    steps   neighbouring codes of 8 bits are no visible step apart, or the product says they are
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, median_filter

from compensate.steps import COARSE, share_of_steps
from domesim.light import Light
from domesim.light.transfer import named
from domesim.scene import Scene
from validation import seen
from validation.judges import luminance

SURROUNDINGS = 2.0
"""Distance within which pixels surround one, degrees."""
PLACE = 1.0
"""Standard deviation of the mean of a place, degrees."""
POINT = 2.0
"""Ratio of a point's light to its surroundings', at least."""
ALIKE = 0.05
"""Relative difference of light below which surroundings are the same."""
HARDLY = 1e-3
"""Light that counts as none, cd/m²: a fifth of the black that judges know."""

Floats: TypeAlias = NDArray[np.floating[Any]]
Mask: TypeAlias = NDArray[np.bool_]


@final
@dataclass(frozen=True)
class Shown:
    """A picture, and what is seen of it.

    Parameters
    ----------
    master, untouched, subtracted, seen
        (view, row, col, primary), 1 = projector white: what should be seen, and what is seen of the
        master as it is, of its exact subtraction, and of a method's light.
    scene
        Where.
    balls
        Smooth balls that are known to be in it: x, y and radius, in halves of the picture from its
        middle, as `content.charts` has them.
    """

    master: Light
    untouched: Light
    subtracted: Light
    seen: Light
    scene: Scene
    balls: Sequence[tuple[float, float, float]] = ()

    @cached_property
    def screen(self) -> Mask:
        """(row, col) pixels that count."""
        return self.scene.screen(*self.master.shape[1:3])

    def pixels(self, degrees: float) -> float:
        """A length, in pixels."""
        return degrees * self.scene.viewing.pixels_per_degree(*self.master.shape[1:3])

    def luminances(self) -> Iterator[tuple[Floats, Floats, Floats]]:
        """(row, col) cd/m² of the master, untouched and seen, view by view."""
        white = self.scene.projector.white
        lights = (self.master, self.untouched, self.seen)
        yield from zip(*(white * luminance(each, self.scene) for each in lights), strict=True)


@final
@dataclass(frozen=True)
class Law:
    """A law.

    Parameters
    ----------
    name
        One word.
    bound
        Largest figure that keeps it, with the tolerance that its function states.
    figure
        What is asked of a picture.
    of_domes
        Whether it holds only where all of a picture is polluted alike, as in domes.
    """

    name: str
    bound: float
    figure: Callable[[Shown], float | None]
    of_domes: bool = False


def order(shown: Shown) -> float | None:
    """Largest share by which a pixel is seen darker than one that it should outshine.

    Compared are pixels that touch along a row or a column, and points (`points`), whose
    surroundings are `ALIKE`: their mean and harmonic mean, of points their median, too, and the
    veil over them. One should outshine the other if no primary of its master is less, and it is
    brighter by `ALIKE` and by `HARDLY`. The tolerance is `ALIKE`, too. Where light ends at white,
    both are equal.
    """
    found = [0.0]
    for view, (master, untouched, now) in enumerate(shown.luminances()):
        light = shown.master[view]
        at, around = points(shown, view)
        others = shown.screen & ~maximum_filter(at, 3)
        means = [
            seen.mean_within(plane, others, shown.pixels(PLACE))
            for plane in (master, 1 / np.maximum(master, HARDLY))
        ]
        for offset in ((0, 1), (1, 0)):
            here, there = _moved(offset, now.shape)
            on = shown.screen[here] & shown.screen[there]
            for plane in means:
                apart = np.abs(plane[here] - plane[there])
                on = on & (apart <= ALIKE * np.maximum(plane[here], plane[there]))
            for first, second in ((here, there), (there, here)):
                should = on & _outshines(light[first], light[second], master[first], master[second])
                found.append(_fall(now[first][should], now[second][should]))
        alike = [_alike(each[at]) for each in (around, *means, untouched - master)]
        should = np.logical_and.reduce(alike) & _outshines(
            light[at][:, None], light[at][None], master[at][:, None], master[at][None]
        )
        bright, faint = np.nonzero(should)
        found.append(_fall(now[at][bright], now[at][faint]))
    return max(found)


def bound(shown: Shown) -> float | None:
    """Largest ratio of the light that a pixel gains over the master to that of its surroundings.

    These are the pixels from half of `SURROUNDINGS` to all of it away of which no primary is
    brighter in the master; they count by the largest of their gains, and by `HARDLY` or 1 % of the
    pixel's own light at least. Asked are pixels that outshine so at least half of what is that far
    away. The tolerance is 5 % of the two times that are allowed.
    """
    reach = int(np.ceil(shown.pixels(SURROUNDINGS)))
    down, right = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    away = np.hypot(down, right)
    ring = (away <= reach) & (away >= reach / 2)
    found: list[float] = []
    for view, (master, _, now) in enumerate(shown.luminances()):
        light, gain = shown.master[view], np.where(shown.screen, now - master, -np.inf)
        of_others, outshone = np.full_like(gain, -np.inf), np.zeros(gain.shape)
        for offset in zip(down[ring], right[ring], strict=True):
            here, there = _moved(offset, gain.shape)
            darker = np.all(light[there] <= light[here], axis=-1)
            gains = np.where(darker, gain[there], -np.inf)
            np.maximum(of_others[here], gains, out=of_others[here])
            outshone[here] += darker & shown.screen[there]
        asked = shown.screen & np.isfinite(of_others) & (outshone >= ring.sum() / 2)
        least = np.maximum(0.01 * master, HARDLY)
        ratio = gain[asked] / np.maximum(of_others, least)[asked]
        found.append(float(np.max(ratio, initial=0)))
    return max(found)


def stars(shown: Shown) -> float | None:
    """Largest share by which a point (`points`) departs from the light that it may have.

    That is from what subtraction shows of it, which is its own, to what it is untouched, with all
    of the veil. The tolerance is stated, not derived: 1.5 times, which is 0.44 magnitudes.
    """
    white, found = shown.scene.projector.white, []
    own = white * luminance(shown.subtracted, shown.scene)
    for view, (_, untouched, now) in enumerate(shown.luminances()):
        at, _ = points(shown, view)
        if at.any():
            high, low = now[at] / untouched[at], own[view][at] / np.maximum(now[at], HARDLY)
            found.append(float(max(np.max(high), np.max(low), 1)) - 1)
    return max(found, default=None)


def harm(shown: Shown) -> float | None:
    """Largest ratio of the light of a place to what it is untouched.

    A place is a mean of `PLACE`. The tolerance is 2 %.
    """
    found: list[float] = []
    for _, untouched, now in shown.luminances():
        before, after = (
            seen.mean_within(plane, shown.screen, shown.pixels(PLACE)) for plane in (untouched, now)
        )
        found.append(float(np.max((after / np.maximum(before, HARDLY))[shown.screen])))
    return max(found)


def dark(shown: Shown) -> float | None:
    """Light of the master's darker half, over what it is untouched. The tolerance is 0.1 %."""
    found: list[float] = []
    for master, untouched, now in shown.luminances():
        half = shown.screen & (master <= np.median(master[shown.screen]))
        found.append(float(now[half].sum() / max(untouched[half].sum(), HARDLY)))
    return max(found)


def exact(shown: Shown) -> float | None:
    """Largest departure from a master that subtraction shows exactly, white = 1.

    None if any of the picture is not exact. The tolerance is that of `seen.EXACT`, which is more
    than rounding.
    """
    on = np.broadcast_to(shown.screen, shown.master.shape[:3])
    if np.abs(shown.subtracted - shown.master)[on].max() > seen.EXACT:
        return None
    return float(np.abs(shown.seen - shown.master)[on].max())


def limb(shown: Shown) -> float | None:
    """Largest share by which light rises outwards around a ball, where the master's does not.

    Light is averaged by rings of one pixel from half of a ball's radius to one and a half of it.
    The tolerance is 0.5 %.
    """
    found: list[float] = []
    rows, cols = shown.screen.shape
    down, right = np.mgrid[:rows, :cols]
    for x, y, radius in shown.balls:
        away = np.hypot((right + 0.5) / cols * 2 - 1 - x, (down + 0.5) / rows * 2 - 1 - y)
        rings = np.floor(away * cols / 2).astype(int)[shown.screen]
        counted = slice(int(radius * cols / 4), int(radius * cols * 0.75))
        for master, _, now in shown.luminances():
            wanted, light = (
                (np.bincount(rings, plane[shown.screen]) / np.bincount(rings))[counted]
                for plane in (master, now)
            )
            falls = np.diff(wanted) <= 0
            found.append(float(np.max((np.diff(light) / light[:-1])[falls], initial=0)))
    return max(found, default=None)


def steps(shown: Shown) -> float | None:
    """Contrast between pixels that touch, and whose codes of 8 bits are neighbours.

    It is that which twice the share of the screen exceeds that the product tells of (`COARSE`).
    None if the master is not of 8 bits (sRGB), or if the product tells. Codes are neighbours if no
    primary differs by more than one. The contrast is the difference of light over the lesser.
    """
    codes = 255 * named("srgb", white=1.0).encode(np.clip(shown.master, 0, 1))
    on = np.broadcast_to(shown.screen, shown.master.shape[:3])
    if np.abs(codes - np.round(codes))[on].max() > 0.02:  # single precision keeps 0.001
        return None
    weights = shown.scene.projector.luminance_weights
    if share_of_steps(list(codes / 255), 255, shown.seen, shown.screen, weights) > COARSE:
        return None
    found = [np.zeros(1)]
    for view, (_, _, now) in enumerate(shown.luminances()):
        for offset in ((0, 1), (1, 0)):
            here, there = _moved(offset, now.shape)
            apart = np.abs(np.round(codes[view][here]) - np.round(codes[view][there])).max(-1)
            near = (apart == 1) & shown.screen[here] & shown.screen[there]
            low = np.maximum(np.minimum(now[here], now[there]), HARDLY)
            found.append((np.abs(now[here] - now[there]) / low)[near])
    contrasts, few = np.sort(np.concatenate(found)), int(4 * COARSE * on.sum())
    return float(contrasts[max(len(contrasts) - 1 - few, 0)])


def points(shown: Shown, view: int) -> tuple[Mask, Floats]:
    """Finds the points of a view of the master.

    A point is brighter than all eight pixels around it, and `POINT` times as bright as the median
    of its surroundings, which are at least `HARDLY`.

    Parameters
    ----------
    shown
        The master, and what is seen of it.
    view
        Its number.

    Returns
    -------
    points, around
        (row, col) which pixels are points, and what surrounds pixels, cd/m².
    """
    white = shown.scene.projector.white
    plane = white * luminance(shown.master[view : view + 1], shown.scene)[0]
    side = 2 * round(shown.pixels(SURROUNDINGS / 2)) + 1
    around = np.maximum(median_filter(plane, side), HARDLY)
    ring = np.ones((3, 3), bool)
    ring[1, 1] = False
    peak = plane > maximum_filter(plane, footprint=ring)
    return np.asarray(peak & (plane > POINT * around) & shown.screen), around


LAWS: tuple[Law, ...] = (
    Law("order", ALIKE, order, of_domes=True),
    Law("bound", 2.1, bound, of_domes=True),
    Law("stars", 0.5, stars, of_domes=True),
    Law("harm", 1.02, harm, of_domes=True),
    Law("dark", 1.001, dark, of_domes=True),
    Law("exact", seen.EXACT, exact),
    Law("limb", 0.005, limb, of_domes=True),
    Law("steps", 0.1, steps, of_domes=True),
)


def _outshines(light: Floats, other: Floats, bright: Floats, dark: Floats) -> Mask:
    """Where no primary is less, and light is visibly more."""
    more = bright > np.maximum((1 + ALIKE) * dark, dark + HARDLY)
    return np.asarray(more & np.all(light >= other, axis=-1))


def _fall(bright: Floats, dark: Floats) -> float:
    """Largest share by which what should be brighter is darker."""
    return float(np.max((dark - bright) / np.maximum(dark, HARDLY), initial=0.0))


def _alike(values: Floats) -> Mask:
    """(n, n) which values differ by less than `ALIKE`."""
    first, second = values[:, None], values[None, :]
    return np.asarray(np.abs(first - second) <= ALIKE * np.maximum(first, second))


def _moved(offset: tuple[int, int], shape: tuple[int, ...]) -> tuple[tuple[slice, ...], ...]:
    """Where pixels are that have another one at that offset, and where these are."""
    here, there = [], []
    for step, size in zip(offset, shape, strict=True):
        here.append(slice(max(-step, 0), size - max(step, 0)))
        there.append(slice(max(step, 0), size - max(-step, 0)))
    return tuple(here), tuple(there)
