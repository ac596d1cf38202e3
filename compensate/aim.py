"""The aim: what can be shown of a master over light that cannot be taken away.

Over a raised black the eye cannot have the master's *light*. It can have its *contrast* and its
hue. Equation 3 of the paper allows any model lambda, so contrasts are compared, each relative to
what the eye is adapted to in that place:

    lambda(y) = (y - B_y) / (B_y + c)

B_y is the local mean of y, and c a luminance below which the eye loses contrast. lambda(psi(x)) =
lambda(m) for the master m holds where

    psi(x) = m B' / B,      B = B_m + c                                           (the aim)

for any base B' of what is seen. The aim has the master's contrast and its hue, and it is at least
as bright as the light that is missing if B' is chosen so. Exact subtraction then shows it: no
solver and no transform is needed.

*Domes.* All of the screen is polluted alike, so one number says how far it is lifted: v, by u that
is `lift` times the light that is missing in the darkest part of the screen. What the eye hardly
sees is not worth a lift. Black is lifted by all of v, and what is bright by nothing:

    v = u² / (u + 3 c)
    B' = B + max(v - B / fade, 0)

Where nothing is missing v is 0, and the aim is the master. B keeps edges: it is a guided mean
(`means.coefficients`). Dark places take the mean in which a pixel counts by its darkness, so that
nothing bright nearby raises their base and leaves a dark rim; what stands out from that by `edge`
takes the plain one. Some saturated colours still need less light of one primary than subtraction
leaves. Exact clipping would turn a blue sky purple. So a share of what is missing in the worst
primary is added to the others, in places that are lifted anyhow. B and v are known by blocks of
half a degree, and linear in between: what they cost does not grow with the picture.

A 3D dome's views are lifted by the same v, the larger of both; what is left then is of pairs.

*Pairs.* A ghost is missing light in one place of one eye. Its own light cannot be hidden, but its
edges can, which are none of the picture's and hinder fusion (section 1): just outside a ghost g the
aim has a *veil*, of the scales s from half of `reach` down by octaves,

    V = max_s min(lift G_s g, G_s g² / G_s g),    R = max(V - g, 0) / (1 + Y_V / f (Y_m + c))
    aim = m + (m + R) Y_R / (Y_m + Y_R)

G_s is a local mean, known as finely as it is smooth. The second term is the mean of g weighted by
itself, which limits a veil to the ghost's own brightness. On black, a veil is seen as well as the
ghost that it hides: the more it stands out from the master's luminance Y_m, the fainter it is. It
has the ghost's colour on black, and that of the master where that is brighter: its hue stays.

Display-adaptive tone mapping has the same idea for whole displays: R. Mantiuk, S. Daly, L.
Kerofsky, "Display Adaptive Tone Mapping", ACM Trans. Graph. 27(3), 2008. How the numbers were
chosen, and what lost: ``validation/notes/0007``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import TypeAlias, final

from compensate.means import (
    block_sums,
    coefficients,
    enlarged,
    enlarged_rows,
    smooth,
)
from compensate.weighting import PerceptualWeighting
from domesim.errors import InputError, require_not_negative, require_positive
from domesim.light import Array, Light, namespace, total
from domesim.light.strips import SAMPLES, in_parts

OCTAVES = 4
"""Scales of veils."""
NEARBY = 0.08
"""Degrees around in which a veil stands out from luminance."""
BLOCKS = 2
"""A degree: how finely a dome's base is known. Its mean is over `Aim.reach`, four of them."""
HARDLY = 3.0
"""Times c: missing light of which half counts."""
_BOXED = 2  # standard deviations of a veil's means, in blocks: from this to twice as many
_TINY = 1e-9  # of white


@final
@dataclass(frozen=True)
class Aim:
    """How much of the black is given up for contrast, and where.

    Parameters
    ----------
    lift
        How many times the missing light dark places are lifted. 0 keeps the deepest black, which is
        plain subtraction; 4 keeps all contrast.
    fade
        How many times as bright as a dome's lift a place must be to keep its light as it is.
    darkest
        Share of a dome's screen whose missing light decides: its darkest part.
    reach
        Size of the places within which contrast is kept, degrees.
    edge
        Contrast beyond which an edge separates two places, in natural logarithms of luminance.
    dark
        Luminance below which the eye loses contrast, cd/m².
    hue
        Share of the missing light of one primary that the others get, so that hues stay.
    faint
        Ratio of a pair's veil to its surroundings at which the veil is halved.

    Raises
    ------
    InputError
        If a number is negative or not finite; `fade`, `reach`, `edge`, `dark`, `faint` and
        `darkest` must be above 0, `darkest` and `hue` at most 1.
    """

    lift: float = 2.5
    fade: float = 8.0
    darkest: float = 0.1
    reach: float = 2.0
    edge: float = 2.0
    dark: float = 0.01
    hue: float = 0.5
    faint: float = 30.0

    def __post_init__(self) -> None:
        require_not_negative("the aim", lift=self.lift, hue=self.hue)
        require_positive(
            "the aim",
            fade=self.fade,
            darkest=self.darkest,
            reach=self.reach,
            edge=self.edge,
            dark=self.dark,
            faint=self.faint,
        )
        for name in ("darkest", "hue"):
            if getattr(self, name) > 1:
                raise InputError(
                    f"the aim's {name} is a share, at most 1; got {vars(self)[name]:g}"
                )

    def raised(self, missing: float, dark: float) -> float:
        """v: how far black is lifted in a dome.

        Parameters
        ----------
        missing
            Luminance that is missing in the darkest places, at least 0, in any unit.
        dark
            Its own, in that unit.
        """
        most = self.lift * missing
        return most * most / (most + HARDLY * dark)


@final
@dataclass(frozen=True)
class Sight:
    """How a picture is seen: what an aim must know of a theatre.

    Parameters
    ----------
    screen
        (row, col) bool: pixels that count.
    weights
        (primary,) of luminance.
    white
        Luminance of 1.0, cd/m².
    density
        Pixels per degree.
    """

    screen: Array
    weights: Array
    white: float
    density: float

    def luminance(self, light: Light) -> Array:
        """(view, row, col), 1 = projector white, at least 0."""
        xp = namespace(light)
        weights = xp.asarray(self.weights, dtype=light.dtype, device=light.device)
        return xp.maximum(light @ weights, xp.zeros_like(light[..., 0]))


Eye: TypeAlias = Aim | PerceptualWeighting
"""What a picture is made for: its contrasts by an aim, or the paper's least squares."""


def lifted(aim: Aim, sight: Sight, wanted: Light, floor: Light, brightest: Light) -> Light:
    """The aim of a dome: the master, lifted with its surroundings.

    Parameters
    ----------
    aim, sight
        Settings, and how the dome is seen.
    wanted
        (view, row, col, primary) what should be seen.
    floor
        Light that is there without any of its own, of subtraction, of the same shape. Hues are kept
        over it.
    brightest
        What is seen of white in its own place; nothing is lifted above.
    """
    lifting = _Lifting(aim, sight, wanted, floor)
    xp, primaries = namespace(wanted), range(wanted.shape[-1])
    found = xp.empty_like(wanted)

    def work(view: int, rows: slice) -> None:
        gain = lifting.gain(view, rows)
        master, least, most = (
            [each[view, rows, :, p] for p in primaries] for each in (wanted, floor, brightest)
        )
        # Limited to what brings the brightest primary to white, so that hues stay
        tiny = xp.full_like(gain, _TINY)
        rooms = (each / xp.maximum(own, tiny) for own, each in zip(master, most, strict=True))
        limited = xp.maximum(xp.minimum(gain, reduce(xp.minimum, rooms)), xp.ones_like(gain))
        own = with_hue(aim, master, [each * limited for each in master], least)
        for p, plane in enumerate(own):
            found[view, rows, :, p] = plane

    in_parts(work, wanted.shape, wanted)
    return found


def with_hue(
    aim: Aim, wanted: Sequence[Array], aimed: Sequence[Array], floor: Sequence[Array]
) -> list[Array]:
    """An aim of a dome that keeps hues where a primary's floor is above it.

    A primary that lacks more than it gets stays below its floor: none of it is projected.

    Parameters
    ----------
    aim
        Settings.
    wanted, aimed
        Planes of each primary, of any shape: the master, and its aim.
    floor
        Light that is there without any of its own.
    """
    xp = namespace(wanted[0])
    none = xp.zeros_like(wanted[0])
    most = reduce(xp.maximum, (low - own for low, own in zip(floor, aimed, strict=True)))
    bright = xp.maximum(reduce(xp.maximum, aimed), xp.full_like(none, _TINY))
    # Only as far as a place is lifted anyhow: elsewhere, what is exact stays exact
    raised = 1 - reduce(xp.maximum, wanted) / bright
    shared = aim.hue * raised * xp.maximum(most, none)
    return [own + shared for own in aimed]


def veiled(aim: Aim, sight: Sight, wanted: Light, left: Light) -> Light:
    """The aim of a pair: the master, with veils that hide the edges of its ghosts.

    Parameters
    ----------
    aim, sight
        Settings, and how the pair is seen.
    wanted
        (2, row, col, primary) what should be seen.
    left
        What subtraction shows too much, at least 0, of the same shape.
    """
    xp, (_, _, cols, primaries) = namespace(wanted), wanted.shape
    fine = veil_block(scales(aim, sight)[-1])
    grids = _veils(aim, sight, wanted, left, fine)
    result, weights = xp.empty_like(wanted), [float(each) for each in sight.weights]

    def work(view: int, rows: slice) -> None:
        *veils, share = xp.unstack(enlarged_rows(grids[view, ...], fine, rows, cols), axis=0)
        master, ghosts = (
            [each[view, rows, :, p] for p in range(primaries)] for each in (wanted, left)
        )
        rims = [
            xp.maximum(veil - ghost, xp.zeros_like(ghost)) * share
            for veil, ghost in zip(veils, ghosts, strict=True)
        ]
        bright = sight.luminance(wanted[view, rows, ...])
        rim = reduce(xp.add, (w * each for w, each in zip(weights, rims, strict=True)))
        part = rim / xp.maximum(bright + rim, xp.full_like(rim, _TINY))
        for p, (own, more) in enumerate(zip(master, rims, strict=True)):
            result[view, rows, :, p] = own + (own + more) * part

    in_parts(work, wanted.shape, wanted)
    return result


def _veils(aim: Aim, sight: Sight, wanted: Light, left: Light, fine: int) -> Array:
    """(view, primary + 1, row, col) by blocks of `fine` pixels: V, and 1 / (1 + Y_V / ...)."""
    xp, (views, _, _, primaries) = namespace(wanted), wanted.shape

    def sums(view: int, rows: slice) -> Array:
        """(plane, row, col) of some rows by blocks: ghosts, their squares, luminance."""
        ghosts = xp.moveaxis(left[view, rows, ...], -1, 0)
        luminance = sight.luminance(wanted[view, rows, ...])[None, ...]
        return block_sums(xp.concat([ghosts, ghosts**2, luminance]), fine)

    found = _by_blocks(sums, wanted, fine) / block_sums(xp.ones_like(wanted[0, :, :, 0]), fine)
    sigmas = [sigma / fine for sigma in scales(aim, sight)]

    def peaks(view: int, some: slice) -> tuple[Array, Array]:
        """Veils of some primaries, (primary, row, col), and how bright the ghosts are."""
        every = [found[view, some, ...], found[view, primaries:-1, ...][some, ...]]
        size, veil, block = every[0].shape[-2:], xp.zeros_like(every[0]), 1
        one = xp.ones_like(every[0][0, ...])
        for sigma in reversed(sigmas):
            # An octave's means are known as finely as it is smooth
            wider = veil_block(sigma)
            every = [block_sums(each, wider // block) for each in every]
            block, pixels = wider, block_sums(one, wider)
            mean, square = (smooth(each / pixels, sigma / block) for each in every)
            peak = square / xp.maximum(mean, xp.full_like(mean, _TINY))
            veil = xp.maximum(veil, enlarged(xp.minimum(aim.lift * mean, peak), block, size))
        return veil, enlarged(peak, block, size)

    parts = in_parts(peaks, (views, primaries, SAMPLES), wanted)  # a primary a thread
    veil, own = (
        xp.reshape(xp.concat(each), (views, primaries, *found.shape[-2:]))
        for each in zip(*parts, strict=True)
    )
    around = smooth(found[:, -1, ...], NEARBY * sight.density / fine) + aim.dark / sight.white
    stands_out = sight.luminance(xp.moveaxis(own, 1, -1)) / around
    return xp.concat([veil, (1 / (1 + stands_out / aim.faint))[:, None, ...]], axis=1)


def dome_block(density: float) -> int:
    """Pixels along a side of the blocks of which a dome's base is known; of pixels a degree."""
    return max(1, round(density / BLOCKS))


def scales(aim: Aim, sight: Sight) -> list[float]:
    """Standard deviations of veils' means, pixels: from half of the reach down by octaves."""
    return [aim.reach * sight.density / 2 ** (octave + 1) for octave in range(OCTAVES)]


def veil_block(sigma: float) -> int:
    """Pixels along a side of the blocks of which a veil is known that is as smooth as `sigma`."""
    block = 1
    while sigma / (2 * block) >= _BOXED:
        block *= 2
    return block


@final
class _Lifting:
    """How much a dome is lifted, B' / B, in two passes over strips of all views.

    Eyes that are lifted differently would see two blacks.

    Parameters
    ----------
    aim, sight, wanted, floor
        As for `lifted`.
    """

    def __init__(self, aim: Aim, sight: Sight, wanted: Light, floor: Light) -> None:
        self._aim, self._sight, self._wanted, self._floor = aim, sight, wanted, floor
        block = self._block = dome_block(sight.density)
        self._missing = 0.0
        self._grids: list[Array] = []  # (slope and offset of all, and of what is dark; row, col)
        # The first pass: what is missing, and the bases by blocks
        xp = namespace(wanted)
        radius = max(1, round(aim.reach * sight.density / block))
        for found in xp.unstack(_by_blocks(self._sums, wanted, block), axis=0):
            pixels, lacking, *sums = xp.unstack(found, axis=0)
            missing = aim.raised(_missing(aim, pixels, lacking), aim.dark / sight.white)
            self._missing = max(self._missing, missing)
            first, second, weight, dark_first, dark_second = sums
            of_all = coefficients(pixels, pixels, first, second, radius, aim.edge)
            of_dark = coefficients(pixels, weight, dark_first, dark_second, radius, aim.edge)
            self._grids.append(xp.stack([*of_all, *of_dark]))

    def gain(self, view: int, rows: slice) -> Array:
        """The second pass: the gain of some rows, (row, col)."""
        xp, aim = namespace(self._wanted), self._aim
        logs = xp.log(self._luminance(view, rows) + aim.dark / self._sight.white)
        grids = enlarged_rows(self._grids[view], self._block, rows, logs.shape[-1])
        grids = xp.unstack(grids, axis=0)
        of_all, of_dark = (slope * logs + offset for slope, offset in (grids[:2], grids[2:]))
        none, one = xp.zeros_like(logs), xp.ones_like(logs)
        share = xp.minimum(xp.maximum((logs - of_dark) / aim.edge, none), one)
        base = xp.exp(of_dark + (of_all - of_dark) * share)
        return 1 + xp.maximum(self._missing - base / aim.fade, none) / base

    def _luminance(self, view: int, rows: slice) -> Array:
        return self._sight.luminance(self._wanted[view, rows, ...])

    def _sums(self, view: int, rows: slice) -> Array:
        """(7, row, col) of some rows by blocks: pixels, missing light, what bases are made of.

        That is the logarithm of luminance and its square, and both by importance, which comes
        first.
        """
        xp, sight = namespace(self._wanted), self._sight
        luminance, dark = self._luminance(view, rows), self._aim.dark / sight.white
        on = xp.astype(sight.screen[rows, :], luminance.dtype)
        lacking = on * (sight.luminance(self._floor[view, rows, ...]) - luminance)
        logs = xp.log(luminance + dark)
        weights = on * (dark / (luminance + dark))
        first, of_dark = on * logs, weights * logs
        planes = on, lacking, first, first * logs, weights, of_dark, of_dark * logs
        return block_sums(xp.stack(planes), self._block)


def _by_blocks(sums: Callable[[int, slice], Array], wanted: Light, block: int) -> Array:
    """(view, plane, row, col) of `sums(view, rows)`, by strips of whole rows of blocks."""
    views, rows, cols, primaries = wanted.shape
    xp, shape = namespace(wanted), (views, -(-rows // block), block * cols * primaries)

    def strip(view: int, blocks: slice) -> Array:
        return sums(view, slice(blocks.start * block, min(blocks.stop * block, rows)))

    parts = in_parts(strip, shape, wanted)
    each = len(parts) // views
    return xp.stack(
        [xp.concat(parts[view * each : (view + 1) * each], axis=1) for view in range(views)]
    )


def _missing(aim: Aim, pixels: Array, sums: Array) -> float:
    """Mean of the missing light over the `darkest` share of the screen, where most is missing.

    Places are blocks, as of the base: no single pixel decides, however many there are. A block has
    so many `pixels` on the screen, in which so much is missing in all.
    """
    xp = namespace(pixels)
    counted, sums = pixels[pixels > 0], sums[pixels > 0]
    means = xp.maximum(sums, xp.zeros_like(sums)) / counted
    order = xp.argsort(-means, stable=True)
    counted, means = (xp.astype(xp.take(each, order), xp.float64) for each in (counted, means))
    most = aim.darkest * total(counted)
    before = xp.cumulative_sum(counted) - counted
    share = xp.clip(most - before, 0 * counted, counted)
    return float(total(share * means) / most)
