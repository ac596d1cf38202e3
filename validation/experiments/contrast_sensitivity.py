"""A grating at the threshold of visibility has an error of one just-noticeable difference.

Rationale
    All visible errors are multiples of just-noticeable differences, by Daly's contrast sensitivity
    (1992; the paper, section 4). A wrong constant would scale every figure and shift the trade
    between frequencies, and no solver would notice. So a grating is drawn whose contrast is the
    threshold that the published formula gives, worked out elsewhere (design section 4: 119.6, 147.1
    and 33.9 at 1, 4 and 13.4 cycles/degree, 5 cd/m², 3 m, 1282.28 deg²), and goes the whole way
    through the program's weighting.
Expected
    The formula gives the values worked out elsewhere within 0.1 %. A grating of 1 or 4
    cycles/degree at threshold has an error of 1 JND (amplitude) within 2 %, at twice the threshold
    twice that. A blank field's error is governed by the low-frequency policy: with a floor of 0.1
    it counts a tenth of the peak, with 0 (the paper's) nothing at all.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from compensate.vision.csf import LowFrequencyFloor, daly
from compensate.weighting import PerceptualWeighting
from domesim.room.viewing import Viewing, of_flat_screen
from validation.drawing import plot
from validation.experiment import Column, Finding, Table, Work, at_most, between

WORKED_OUT: Mapping[float, float] = {1.0: 119.6, 4.0: 147.1, 13.404: 33.9}
"""Sensitivity by cycles/degree, horizontal gratings: the formula, worked out by others."""

ADAPTATION = 5.0
SIZE = (360, 640)
CONDITIONS = {"adaptation": ADAPTATION, "distance": 3.0, "image_area": 1282.28}
_GREY = np.array([1 / 3, 1 / 3, 1 / 3])


def error_of_grating(frequency: float, contrast: float, floor: float = 0.1) -> float:
    """Visible error, JND (amplitude), of a vertical grating that ought not to be there.

    Parameters
    ----------
    frequency
        Cycles/degree; 0 for a blank veil of that contrast.
    contrast
        Amplitude over the adaptation luminance.
    floor
        The low-frequency policy.
    """
    rows, cols = SIZE
    # A quarter of the paper's picture, at its resolution and its Daly's i²
    extent = of_flat_screen(2.5, 1.4, 3.0, ADAPTATION).extent / 2
    viewing = Viewing(extent, CONDITIONS["image_area"], CONDITIONS["distance"], ADAPTATION)
    weighting = PerceptualWeighting(LowFrequencyFloor(floor))(
        viewing, _GREY, np.ones(SIZE, np.bool_)
    )
    degrees = np.arange(cols) / viewing.pixels_per_degree(rows, cols)
    wave = np.cos(2 * np.pi * frequency * degrees)
    residual = np.broadcast_to(contrast * wave[None, None, :, None], (1, rows, cols, 3))
    seen = np.asarray(weighting.apply(residual.astype(np.float64)))[0, 0, :rows, :cols]
    middle = seen[rows // 4 : -rows // 4, cols // 4 : -cols // 4] * weighting.peak
    # Amplitude of a wave from its rms; a veil is its own amplitude
    return float(np.sqrt(np.mean(middle**2)) * (np.sqrt(2) if frequency else 1))


def run(work: Work) -> Finding:
    """Compare with the published values, and send gratings through."""
    found = {rho: float(daly(rho, 0.0, **CONDITIONS)) for rho in WORKED_OUT}
    checks = [
        at_most(
            f"sensitivity at {rho:g} cycles/degree over {elsewhere:g}, worked out elsewhere",
            abs(found[rho] / elsewhere - 1),
            1e-3,
        )
        for rho, elsewhere in WORKED_OUT.items()
    ]
    gratings = work.step("gratings", dict[str, float], _gratings)
    checks += [
        between("grating of 1 c/deg at threshold", gratings["1"], 0.98, 1.02, "JND"),
        between("grating of 4 c/deg at threshold", gratings["4"], 0.98, 1.02, "JND"),
        between("grating of 4 c/deg at twice the threshold", gratings["twice"], 1.96, 2.04, "JND"),
        between("veil of 1 % contrast, floor 0.1, over peak", gratings["veil"], 0.09, 0.11),
        at_most("the same, floor 0 (the paper's)", gratings["veil, pure"], 0.02),
    ]
    return Finding(
        result=(
            "The program's Daly formula gives the values that others worked out from the "
            "published one; a grating of 4 cycles/degree at threshold contrast comes out of the "
            f"whole weighting with {gratings['4']:.3f} JND. An even veil counts "
            f"{gratings['veil']:.2f} of the most visible grating of its contrast with the "
            f"default low-frequency floor, and {gratings['veil, pure']:.3f} with none: pure Daly, "
            "as the paper has it, cannot see a dome's grey veil at all."
        ),
        checks=tuple(checks),
        plots=(
            plot(
                "Daly's contrast sensitivity at 5 cd/m², 3 m and 1282 deg², of gratings along the "
                "horizontal or vertical and at 45°; dots: worked out elsewhere; dashed: the "
                "default low-frequency floor of a tenth of the peak, which pure Daly has not.",
                "A band-pass curve through three points.",
                _curve,
            ),
        ),
        tables=(
            Table(
                caption="Sensitivity (1 / threshold contrast).",
                columns=(
                    Column(name="frequency", unit="cycles/degree", digits="g"),
                    Column(name="worked out elsewhere", digits=".1f"),
                    Column(name="computed", digits=".2f"),
                ),
                rows=tuple((rho, elsewhere, found[rho]) for rho, elsewhere in WORKED_OUT.items()),
            ),
        ),
        figures={"contrast_sensitivity.grating": gratings["4"]},
    )


def _gratings() -> dict[str, float]:
    peak = daly(np.geomspace(0.5, 20, 400), 0.0, **CONDITIONS).max()
    return {
        "1": error_of_grating(1.0, 1 / WORKED_OUT[1.0]),
        "4": error_of_grating(4.0, 1 / WORKED_OUT[4.0]),
        "twice": error_of_grating(4.0, 2 / WORKED_OUT[4.0]),
        "veil": error_of_grating(0.0, 0.01) / (0.01 * peak),
        "veil, pure": error_of_grating(0.0, 0.01, floor=0.0) / (0.01 * peak),
    }


def _curve(axes: Any) -> None:
    rho = np.geomspace(0.01, 50, 500)
    (line,) = axes.plot(rho, daly(rho, 0.0, **CONDITIONS), label="horizontal or vertical")
    axes.plot(rho, daly(rho, np.pi / 4, **CONDITIONS), label="at 45°")
    axes.plot(
        list(WORKED_OUT),
        list(WORKED_OUT.values()),
        "o",
        color="black",
        label="worked out elsewhere",
    )
    sensitivity = daly(rho, 0.0, **CONDITIONS)
    peak, at = sensitivity.max(), rho[sensitivity.argmax()]
    below = rho < at
    axes.plot(
        rho[below], np.maximum(sensitivity, 0.1 * peak)[below], "--", color=line.get_color(), lw=1
    )
    axes.set(
        xscale="log",
        yscale="log",
        ylim=(1, 300),
        xlabel="frequency, cycles/degree",
        ylabel="sensitivity (1 / threshold contrast)",
    )
    axes.legend()
