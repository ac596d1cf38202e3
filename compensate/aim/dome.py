"""The aim of a dome: the master, lifted with its surroundings over a floor that cannot be darkened.

Where light is missing, the eye cannot have the master's light. It can have its contrast and its
hue. Equation 3 of the paper allows any model lambda, so contrasts are compared, each relative to
what the eye is adapted to in that place:

    lambda(y) = (y - B_y) / (B_y + c)

B_y is the local mean of y, c a luminance below which the eye loses contrast. With m the master's
luminance and c, and B = B_m + c, lambda(psi(x)) = lambda(m) holds where psi(x) = m B' / B, for any
base B' of what is seen. The aim chooses B', and bounds what stands out from it.

*How far black is lifted.* All of the screen is polluted alike, so one number says it: `lift` times
the light that is missing in the darkest part of the screen,

    v = lift mean(floor - m)

*The base* takes all of v where it is black, and less the brighter it is:

    B' = (B² + v²)^(1/2)

B is a guided mean of log m (`compensate.blocks.guided`), which keeps edges. A pixel counts by its
darkness, c / m, so that nothing bright nearby raises the base of what is dark and leaves a rim.

*Texture and points.* Below its base a pixel keeps its contrast, m' = m B' / B. What stands out, a
star, would be multiplied until it meets white. So each pixel adds its own part u of v as its base
does; u is at most 2 v, and the slope at m = B is that of texture:

    m' = (m² + u²)^(1/2)

    u = v m / B                                m <= B
    u = v (2 - B / m)                          m >  B
    u = v m / B  t (2 - t)                     t = min(B / m, 1)            (both in one)

Light rises with light, and nothing gains more than twice what its surroundings do: m' - m falls
with m where u stays. What is much brighter than v is left as it is, so that no base, however it
varies around a limb, draws a rim inside it.

*Colour.* The floor leaves too much of some primaries. To lift the others alone would show a blue
sky as purple. So a lifted colour is mixed with grey of the same luminance Y'. The share
of grey grows with the lift, and as the weakest primary falls from the floor to half of it:

    m'_p = Y' + k (m'_p - Y'),     k = 1 - (1 - m / m') (1 - max(2 min_p(m'_p / floor_p, 1) - 1, 0))

*No harm.* What is over the floor, which is what will be projected, never has more luminance than
the master. So nothing is seen brighter than untouched: there the light that is now subtracted
is seen, too:

    m'_p = m'_p - (1 - q) over_p,      over_p = max(m'_p - floor_p, 0),      q = min(Y / Y_over, 1)

Where nothing is missing, v is 0, and the aim is the master: what is exact stays exact. Both eyes of
a 3D dome are lifted by the same v, over the brighter floor: else they would see two blacks.

B and v are known by blocks of half a degree, and are linear in between: what they cost does not
grow with the picture.

Display-adaptive tone mapping has the same idea for whole displays: R. Mantiuk, S. Daly, L.
Kerofsky, "Display Adaptive Tone Mapping", ACM Trans. Graph. 27(3), 2008. The laws, how the numbers
were chosen, and what lost: ``validation/notes/0007``.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce

import numpy as np

from compensate.aim.settings import Aim, Sight
from compensate.blocks import guided
from domesim.light import Array, Light, namespace, total
from domesim.light.blocks import block_sums_within, by_blocks, enlarged_across, enlarged_down
from domesim.light.planes import Planes, empty_light, planes_of
from domesim.light.strips import in_parts

DARK = 0.005
"""c, cd/m²: luminance below which the eye loses contrast."""
DARKEST = 0.1
"""Share of the screen whose missing light decides: its darkest part."""
REACH = 2.0
"""Degrees within which contrast is kept: radius of the guided mean, whose weights fall to it."""
EDGE = 1.0
"""Contrast, in natural logarithms, above which an edge separates two places."""
BLOCKS = 2
"""Blocks a degree: how finely the base is known."""
_TINY = 1e-9  # of white


def block_of(density: float) -> tuple[int, int]:
    """Returns the side of a block, pixels, and the guided mean's radius, blocks."""
    block = max(1, round(density / BLOCKS))
    return block, max(1, round(REACH * density / block))


def gain_of(m: Array, B: Array, v: float) -> Array:
    """Computes how many times its light a pixel is lifted to.

    Parameters
    ----------
    m, B
        The master's luminance with c, and its base; of one unit and shape.
    v
        How far black is lifted.

    Returns
    -------
    gain
        m' / m, from 1.
    """
    xp = namespace(m)
    t = xp.minimum(B / m, xp.ones_like(m))
    u = 2 - t
    u *= t
    u *= v
    u /= B
    u *= u
    u += 1
    return xp.sqrt(u)


def lifted(
    aim: Aim, sight: Sight, wanted: Light | Planes, floor: Light | Planes, brightest: Light
) -> Light:
    """Lifts the master with its surroundings.

    Parameters
    ----------
    aim, sight
        Settings, and how the dome is seen.
    wanted
        (view, row, col, primary) what should be seen, 1 = projector white: light, or what tells it.
    floor
        Light that is there without any of its own, over subtraction of the master; as `wanted`.
    brightest
        (view, row, col, primary) what is seen of white in its own place; nothing is lifted above.

    Returns
    -------
    light
        (view, row, col, primary) what is aimed at; 0 where a strip has no screen.
    """
    xp, shape = namespace(brightest), brightest.shape
    own_of, floors, white_of = (
        each if callable(each) else planes_of(each) for each in (wanted, floor, brightest)
    )
    views, _, cols, _ = shape
    block, _ = block_of(sight.density)
    v, bases = _bases(aim, sight, own_of, floors, brightest)
    if xp is np:
        aimed = empty_light(shape, brightest.dtype)
    else:
        aimed = xp.empty(shape, dtype=brightest.dtype, device=brightest.device)

    def work(view: int, rows: slice) -> None:
        some = sight.columns(rows)
        own, white = (each(view, rows, some) for each in (own_of, white_of))
        each_floor = zip(*(floors(each, rows, some) for each in range(views)), strict=True)
        low = [reduce(xp.maximum, each) for each in each_floor]
        none = xp.zeros_like(own[0])
        one, tiny = none + 1, none + _TINY
        luminance = xp.maximum(_luminance(sight, own), none)
        m = luminance + DARK / sight.white
        slope, offset = xp.unstack(enlarged_down(bases[view][..., some], block, rows), axis=0)
        # In place where it can be: what is new is fetched into a core's cache
        log_B = xp.log(m)
        log_B *= slope
        log_B += offset
        B = xp.exp(log_B)
        gain = gain_of(m, B, v)
        # Limited to what brings the brightest primary to white, so that hues stay
        room = (w / xp.maximum(x, tiny) for w, x in zip(white, own, strict=True))
        gain = xp.maximum(xp.minimum(gain, reduce(xp.minimum, room)), one)
        Y, lit = luminance * gain, [x * gain for x in own]
        k = reduce(
            xp.minimum, (x / xp.maximum(f, tiny) for x, f in zip(lit, low, strict=True)), one
        )
        k *= 2
        k -= 1
        grey = xp.maximum(k, none)
        grey -= 1
        kept = 1 / gain
        kept -= 1
        kept *= grey
        k = 1 - kept
        lit = [Y + k * (x - Y) for x in lit]
        over = [xp.maximum(x - f, none) for x, f in zip(lit, low, strict=True)]
        q = 1 - xp.minimum(luminance / xp.maximum(_luminance(sight, over), tiny), one)
        for p, (x, more) in enumerate(zip(lit, over, strict=True)):
            aimed[view, rows, some, p] = x - q * more
        for beside in (slice(0, some.start), slice(some.stop, cols)):
            aimed[view, rows, beside, :] = 0

    in_parts(work, shape, brightest)
    return aimed


def _bases(
    aim: Aim, sight: Sight, own_of: Planes, floors: Planes, like: Light
) -> tuple[float, list[Array]]:
    """How far black is lifted, and the base of each view by blocks: (2, block, col), see `guided`.

    `like` has the picture's shape and library.
    """
    xp, shape, cols = namespace(like), like.shape, like.shape[2]
    c, (block, radius) = DARK / sight.white, block_of(sight.density)

    def sums(view: int, rows: slice) -> Array:
        """(5, row, col) by blocks: pixels, missing light, and importance w, w log m, w log² m."""
        some = sight.columns(rows, block)
        luminance, low = (_luminance(sight, each(view, rows, some)) for each in (own_of, floors))
        none = xp.zeros_like(luminance)
        luminance = xp.maximum(luminance, none)
        on = xp.astype(sight.screen[rows, some], luminance.dtype)
        m = luminance + c
        missing = on * (xp.maximum(low, none) - luminance)
        w, log_m = on * (c / m), xp.log(m)
        first = w * log_m
        planes = on, missing, w, first, first * log_m
        return block_sums_within(planes, block, some, cols)

    v, bases = 0.0, []
    for planes in xp.unstack(by_blocks(sums, shape, block, like), axis=0):
        pixels, missing, w, first, second = xp.unstack(planes, axis=0)
        v = max(v, aim.lift * _darkest(pixels, missing))
        base = xp.stack(guided(pixels, w, first, second, radius, EDGE))
        bases.append(enlarged_across(base, block, cols))
    return v, bases


def _luminance(sight: Sight, planes: Sequence[Array]) -> Array:
    """(row, col) of the primaries' planes, 1 = white."""
    first, *others = (float(each) for each in sight.weights)
    found = first * planes[0]
    for weight, plane in zip(others, planes[1:], strict=True):
        found += weight * plane
    return found


def _darkest(pixels: Array, sums: Array) -> float:
    """Mean of the missing light over the darkest share of the screen, where most is missing.

    Places are blocks, as of the base: no single pixel decides, however many there are. A block has
    so many `pixels` on the screen, in which so much is missing in all. Blocks that lack the same
    count alike: their order changes nothing.
    """
    xp = namespace(pixels)
    counted, sums = pixels[pixels > 0], sums[pixels > 0]
    means = xp.maximum(sums, xp.zeros_like(sums)) / counted
    order = xp.argsort(-means, stable=True)
    counted, means = (xp.astype(xp.take(each, order), xp.float64) for each in (counted, means))
    most = DARKEST * total(counted)
    before = xp.cumulative_sum(counted) - counted
    share = xp.clip(most - before, 0 * counted, counted)
    return float(total(share * means) / most)
