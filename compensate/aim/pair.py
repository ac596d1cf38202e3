"""The aim of a pair: the master, with veils that hide the edges of its ghosts.

A ghost is missing light in one place of one eye: the other eye's picture, where subtraction would
need negative light. Its own light cannot be hidden, but its edges can, which are none of the
picture's and hinder fusion (the paper's section 1). So around a ghost g there is a *veil*, its
local mean over a degree, and just outside the ghost the *rim* of it, which is added:

    veil = 3/4 lift G g,     rim = max(veil - g, 0),     m' = m + (m + rim) Y_rim / (Y_m + Y_rim)

On black the rim has the ghost's colour; on what is brighter it has the master's, so that hues stay.
Nothing is darkened. One scale is enough: of four, the widest did as well as all (note 0007).
"""

from __future__ import annotations

from functools import reduce

from compensate.aim.settings import Aim, Sight
from compensate.blocks import smooth
from domesim.light import Light, namespace
from domesim.light.blocks import enlarged, light_means
from domesim.light.strips import in_parts

SPREAD = 1.0
"""Standard deviation of the local mean G, degrees."""
SHARE = 0.75
"""Ratio of a veil's light to its ghost's local mean, for a lift of 1."""
_BOXED = 2  # blocks in G's standard deviation, at least
_TINY = 1e-9  # of white


def block_of(density: float) -> tuple[int, float]:
    """Returns the side of a veil's block, pixels, and G's standard deviation, blocks."""
    sigma, block = SPREAD * density, 1
    while sigma / (2 * block) >= _BOXED:
        block *= 2
    return block, sigma / block


def veiled(aim: Aim, sight: Sight, wanted: Light, ghosts: Light) -> Light:
    """Adds veils around the ghosts of a pair.

    Parameters
    ----------
    aim, sight
        Settings, and how the pair is seen.
    wanted
        (2, row, col, primary) what should be seen, 1 = projector white.
    ghosts
        What subtraction shows too much, at least 0, of the same shape.

    Returns
    -------
    light
        (2, row, col, primary) what is aimed at.
    """
    xp, (_, _, cols, primaries) = namespace(wanted), wanted.shape
    block, sigma = block_of(sight.density)
    means = xp.moveaxis(light_means(ghosts, block), -1, 1)
    veils = SHARE * aim.lift * smooth(means, sigma)
    aimed, weights = xp.empty_like(wanted), [float(each) for each in sight.weights]

    def work(view: int, rows: slice) -> None:
        veil = enlarged(veils[view, ...], block, rows, cols)
        g = [ghosts[view, rows, :, p] for p in range(primaries)]
        rim = [xp.maximum(veil[p, ...] - g[p], xp.zeros_like(g[p])) for p in range(primaries)]
        m = sight.luminance(wanted[view, rows, ...])
        y = reduce(xp.add, (w * each for w, each in zip(weights, rim, strict=True)))
        share = y / xp.maximum(m + y, xp.full_like(y, _TINY))
        for p in range(primaries):
            own = wanted[view, rows, :, p]
            aimed[view, rows, :, p] = own + (own + rim[p]) * share

    in_parts(work, wanted.shape, wanted)
    return aimed
