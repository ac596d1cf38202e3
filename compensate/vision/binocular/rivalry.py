"""Where two eyes rival: by the ratio of their contrasts.

Two eyes that see one thing with unequal contrast rival, and what controls it is the ratio of the
contrasts [1]: the authors' program, which makes pictures of unequal contrast for two eyes, has this
ratio as its one setting, and 0.63 where its example stands. Here the ratio is taken in each band of
frequencies, of the contrasts around a place that is fused; where neither eye sees any contrast
there is nothing to rival. Which bands, and that one is enough, is this project's reading: the
paper's own predictor was not found in text.

[1] F. Zhong, G. A. Koulieris, G. Drettakis, M. S. Banks, M. Chambe, F. Durand, R. K. Mantiuk,
"DiCE: Dichoptic contrast enhancement for VR and stereo displays", ACM Trans. Graph. 38(6), 211
(2019); gfxdisp/DiCE_matlab, `gen_dice.m` and `example.m`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from domesim.light.guarded import guarded

RATIO = 0.63
"""Ratio of contrasts below which two eyes rival (`example.m`)."""
VISIBLE = 1.0
"""Contrast over its threshold from which on the stronger eye sees it."""

Floats = NDArray[np.floating[Any]]


@guarded(left="*s", right="*s")
def contrast_ratio(left: Floats, right: Floats) -> Floats:
    """Divides the lesser contrast by the greater one.

    Parameters
    ----------
    left, right
        Contrasts of at least 0, in any unit; of one shape.

    Returns
    -------
    ratio
        Of the same shape, 0..1; 1 where there is no contrast.
    """
    greater = np.maximum(left, right)
    ratio = np.ones_like(greater)
    return np.divide(np.minimum(left, right), greater, out=ratio, where=greater > 0)


@guarded(left="*s", right="*s")
def rivals(left: Floats, right: Floats) -> NDArray[np.bool_]:
    """Says where two eyes rival.

    Parameters
    ----------
    left, right
        Contrasts over their threshold, at least 0; of one shape.

    Returns
    -------
    rivalry
        Bool, of the same shape.
    """
    seen = np.maximum(left, right) >= VISIBLE
    return np.asarray(seen & (contrast_ratio(left, right) < RATIO))
