"""What is seen of each way, and what of it is lost where, side by side."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from domesim.transfer import named
from validation.crops import Crop, caption
from validation.experiment import Panel, Pictures
from validation.experiments.quality.inputs import DOMEMASTERS, Input, Place, words

LOST = 3.0
"""JOD that a heatmap shows as its brightest."""


def heatmap(crop: Crop, title: str, loss: NDArray[np.float32]) -> Panel:
    """The crop of a (view, row, col) heatmap, JOD lost."""
    from matplotlib import colormaps  # noqa: PLC0415 (as in `drawing`)

    coloured = colormaps["inferno"](loss[:1] / LOST)[..., :3].astype(np.float32)
    return crop.panel(title, named("srgb", white=1.0).decode(coloured), brighter=1)


def side_by_side(
    place: Place, one: Input, master: tuple[Panel, int], rows: Sequence[Sequence[Panel]]
) -> Pictures:
    """What is wanted at a place, what is seen of several ways, and below their heatmaps.

    Parameters
    ----------
    place, one
        Where, and the input there.
    master
        Its crop, and how many times brighter it is shown.
    rows
        Of each way what is seen, and the heatmap if there is one.
    """
    wanted, brighter = master
    heat = [panels[1] for panels in rows if len(panels) > 1]
    text = caption(words(place), brighter, views=1 if one.kind == DOMEMASTERS else 2)
    if heat:
        text += (
            f" Below, what ColorVideoVDP finds lost at each place, from 0 (black) to {LOST:g} JOD "
            f"(light yellow)."
        )
    return Pictures(caption=text, panels=(wanted, *(panels[0] for panels in rows), *heat))
