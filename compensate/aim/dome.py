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

from collections.abc import Callable, Sequence
from functools import partial, reduce
from typing import TypeAlias

from compensate.aim.settings import Aim, Sight
from compensate.blocks import guided
from domesim.light import Array, Light, namespace, total
from domesim.light.blocks import block_sums, by_blocks, enlarged_across, enlarged_down
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
    return xp.sqrt(1 + (v / B * t * (2 - t)) ** 2)


Planes: TypeAlias = Callable[[int, slice], Sequence[Array]]
"""A view and some rows of it -> (row, col) of each primary."""


def lifted(aim: Aim, sight: Sight, wanted: Light, floor: Light | Planes, brightest: Light) -> Light:
    """Lifts the master with its surroundings.

    Parameters
    ----------
    aim, sight
        Settings, and how the dome is seen.
    wanted
        (view, row, col, primary) what should be seen, 1 = projector white.
    floor
        Light that is there without any of its own, over subtraction of the master: of that shape,
        or what tells it of some rows.
    brightest
        What is seen of white in its own place; nothing is lifted above. It broadcasts.

    Returns
    -------
    light
        (view, row, col, primary) what is aimed at.
    """
    xp, (views, _, cols, _) = namespace(wanted), wanted.shape
    c = DARK / sight.white
    block, radius = block_of(sight.density)
    floors = floor if callable(floor) else partial(planes_of, floor)
    weights = [float(each) for each in sight.weights]

    def sums(view: int, rows: slice) -> Array:
        """(5, row, col) by blocks: pixels, missing light, and importance w, w log m, w log² m."""
        m = sight.luminance(wanted[view, rows, ...]) + c
        on = xp.astype(sight.screen[rows, :], m.dtype)
        low = reduce(xp.add, (w * x for w, x in zip(weights, floors(view, rows), strict=True)))
        missing = on * (xp.maximum(low, xp.zeros_like(low)) - m + c)
        w, log_m = on * (c / m), xp.log(m)
        planes = on, missing, w, w * log_m, w * log_m**2
        return xp.stack([block_sums(plane, block) for plane in planes])

    v, bases = 0.0, []
    for planes in xp.unstack(by_blocks(sums, wanted.shape, block, wanted), axis=0):
        pixels, missing, w, first, second = xp.unstack(planes, axis=0)
        v = max(v, aim.lift * _darkest(pixels, missing))
        base = xp.stack(guided(pixels, w, first, second, radius, EDGE))
        bases.append(enlarged_across(base, block, cols))

    aimed = xp.empty_like(wanted)

    def work(view: int, rows: slice) -> None:
        own, white = (planes_of(each, view, rows) for each in (wanted, brightest))
        each_floor = zip(*(floors(each, rows) for each in range(views)), strict=True)
        low = [reduce(xp.maximum, each) for each in each_floor]
        luminance = sight.luminance(wanted[view, rows, ...])
        m = luminance + c
        slope, offset = xp.unstack(enlarged_down(bases[view], block, rows), axis=0)
        B = xp.exp(slope * xp.log(m) + offset)
        none, one, tiny = xp.zeros_like(m), xp.ones_like(m), xp.full_like(m, _TINY)
        gain = gain_of(m, B, v)
        # Limited to what brings the brightest primary to white, so that hues stay
        room = (w / xp.maximum(x, tiny) for w, x in zip(white, own, strict=True))
        gain = xp.maximum(xp.minimum(gain, reduce(xp.minimum, room)), one)
        Y, lit = luminance * gain, [x * gain for x in own]
        k = reduce(
            xp.minimum, (x / xp.maximum(f, tiny) for x, f in zip(lit, low, strict=True)), one
        )
        k = 1 - (1 - 1 / gain) * (1 - xp.maximum(2 * k - 1, none))
        lit = [Y + k * (x - Y) for x in lit]
        over = [xp.maximum(x - f, none) for x, f in zip(lit, low, strict=True)]
        projected = reduce(xp.add, (w * x for w, x in zip(weights, over, strict=True)))
        q = xp.minimum(luminance / xp.maximum(projected, tiny), one)
        for p, (x, more) in enumerate(zip(lit, over, strict=True)):
            aimed[view, rows, :, p] = x - (1 - q) * more

    in_parts(work, wanted.shape, wanted)
    return aimed


def planes_of(light: Light, view: int, rows: slice) -> list[Array]:
    """Looks at some rows of light primary by primary.

    Parameters
    ----------
    light
        (view, row, col, primary).
    view, rows
        Which.

    Returns
    -------
    planes
        (row, col) of each primary, not copied.
    """
    return [light[view, rows, :, p] for p in range(light.shape[-1])]


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
