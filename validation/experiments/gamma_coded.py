"""Light adds up; gamma-coded values do not.

Rationale
    The paper (section 4) gamma-corrects the RGB values and transforms the pollution to YCbCr before
    it computes the compensation. Pollution is linear in light, not in code values.
Expected
    The same solver on gamma-coded values, decoded and observed in linear light, does worse than on
    linear light: more than twice as badly as plain subtraction.
"""

from __future__ import annotations

import numpy as np

from compensate.figures import Appraisal
from compensate.pose import pose
from compensate.solver.admm import ADMM
from compensate.weighting import PerceptualWeighting
from domesim.scene import load_dome
from testing.masters import night
from validation.experiment import Column, Finding, Table, Work, at_least, at_most


def measure(
    size: int = 256, scene: str = "dome_imax", gamma: float = 2.2, seed: int = 0
) -> dict[str, float]:
    """Visible errors (JND rms) by what is projected, and the share that subtraction clips."""
    theatre = load_dome(scene)
    light = night(size, seed)
    posed, coded = (
        pose(each, theatre, PerceptualWeighting())
        for each in (light, light ** np.float32(1 / gamma))
    )
    linear = ADMM()(posed.problem, posed.subtractive).light
    decoded = ADMM()(coded.problem, coded.subtractive).light ** np.float32(gamma)
    return {
        "clipped": Appraisal(posed).clipped,
        "nothing": Appraisal(posed).visible_error(posed.desired),
        "gamma_coded": Appraisal(posed).visible_error(decoded),
        "subtractive": Appraisal(posed).visible_error(posed.subtractive),
        "linear": Appraisal(posed).visible_error(linear),
    }


def run(work: Work) -> Finding:
    """Measure, and say whether it is as expected."""
    size = 128 if work.quick else 256
    found = work.step(f"{size}", dict[str, float], lambda: measure(size, seed=work.seed))
    names = {
        "nothing": "nothing",
        "gamma_coded": (
            "perceptual, solved on gamma-coded values, with the pollution of linear light (one "
            "reading of the paper)"
        ),
        "subtractive": "exact subtraction, in linear light",
        "linear": "perceptual, solved in linear light (ours)",
    }
    worse = found["gamma_coded"] > found["nothing"]
    against = "worse than doing nothing" if worse else "doing nothing has"
    return Finding(
        result=(
            f"Solved on gamma-coded values, the picture that the audience sees has a visible error "
            f"of {found['gamma_coded']:.2f} JND, {against} ({found['nothing']:.2f}); solved in "
            f"linear light, {found['linear']:.3f}."
        ),
        checks=(
            at_least(
                "gamma-coded: visible error over that of subtraction",
                found["gamma_coded"] / found["subtractive"],
                2,
            ),
            at_most(
                "linear light: visible error over that of subtraction",
                found["linear"] / found["subtractive"],
                1,
            ),
        ),
        tables=(
            Table(
                caption=(
                    f"A generated night, {size}², in dome_imax. Exact subtraction clips only "
                    f"{found['clipped']:.1%} of this picture (of the bundled night about three "
                    f"quarters): an easy problem."
                ),
                columns=(Column(name="compensation"), Column(name="visible error", unit="JND rms")),
                rows=tuple((title, found[name]) for name, title in names.items()),
            ),
        ),
        figures={f"gamma_coded.{name}": error for name, error in found.items()},
    )
