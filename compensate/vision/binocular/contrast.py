r"""How two eyes' contrasts make one: two published models.

*Two stages* [1, 2]. In each eye contrast is divided by that of both eyes, their sum is transduced:

    s_L = C_L^m / (S + C_L + C_R)        s = s_L + s_R        r = s^p / (Z + s^q)

C in per cent. Two contrasts are told apart if their responses differ by k. A grating of 1 % in one
eye is at threshold; in both eyes it takes 0.66 %. At high contrast both eyes see hardly more than
one of them.

*Gain control* [3]. At each place each eye divides the other's signal by its own contrast energy e,
and the other's division, too:

    I = (1 + e_L) / (1 + e_L + e_R) I_L + (1 + e_R) / (1 + e_L + e_R) I_R            (eq. 6)

Faint pictures add up; of ordinary ones the eye with more contrast has more weight, and either eye
alone, or both alike, look the same. The formula has no constant, but the unit of e. Here e is the
square of the contrast over its threshold, so that the two regimes meet where contrast begins to be
seen. The paper fits that unit, and an exponent, to its observers; its values were not found in
text.

[1] T. S. Meese, M. A. Georgeson, D. H. Baker, "Binocular contrast vision at and above threshold",
J. Vision 6(11), 7 (2006). [2] D. H. Baker, T. S. Meese, R. F. Hess, "Contrast masking in strabismic
amblyopia", Vision Research 48, 1625 (2008). The constants are those of a public program that names
this paper (its `two_stage_parameters`: m 1.3, S 1, p 8, q 6.5, Z 0.0085, k 0.2). Those of Baker,
Meese and Georgeson 2007 (m 1.28, p 7.99, q 6.59, Z 0.076; `b_s.bmg2007` of VisCog/dynamic_contrast)
come without S and k. [3] J. Ding, G. Sperling, "A gain-control theory of binocular combination",
PNAS 103, 1141 (2006); eq. 6 as `b_s.ds2006` of VisCog/dynamic_contrast has it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from domesim.light.guarded import guarded

M, S = 1.3, 1.0
"""Exponent of an eye's contrast, and its saturation, %."""
P, Q, Z = 8.0, 6.5, 0.0085
"""Exponents and saturation of what both eyes make."""
K = 0.2
"""Difference of responses at threshold."""
MONOCULAR, BINOCULAR = 1.0, 0.6561
"""Contrasts at threshold in one eye, and in both, %: where the response is `K`."""

Floats = NDArray[np.float64]


@guarded(left="*s", right="*s")
def two_stage(left: ArrayLike, right: ArrayLike) -> Floats:
    """Computes the response r to the contrasts of two eyes.

    Parameters
    ----------
    left, right
        Contrasts of at least 0, %; any shapes that go together.

    Returns
    -------
    response
        Of the common shape.
    """
    left, right = (np.asarray(contrast, np.float64) for contrast in (left, right))
    stage = (left**M + right**M) / (S + left + right)
    return np.asarray(stage**P / (Z + stage**Q))


@guarded(left="*s", right="*s", left_energy="*s", right_energy="*s")
def gain_control(
    left: ArrayLike, right: ArrayLike, left_energy: ArrayLike, right_energy: ArrayLike
) -> Floats:
    """Combines what two eyes see into one picture I.

    Parameters
    ----------
    left, right
        Signals, such as signed contrasts in a band; any shapes that go together.
    left_energy, right_energy
        Contrast energies e around there, at least 0.

    Returns
    -------
    picture
        Of the common shape.
    """
    left, right = (np.asarray(signal, np.float64) for signal in (left, right))
    own, other = (np.asarray(energy, np.float64) for energy in (left_energy, right_energy))
    return np.asarray(((1 + own) * left + (1 + other) * right) / (1 + own + other))
