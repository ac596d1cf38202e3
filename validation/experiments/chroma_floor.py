"""Chroma needs another low-frequency policy than luminance.

Rationale
    The paper (section 3.1) weights Y, Cb and Cr with one contrast sensitivity, whose fall at low
    frequencies lets coarse errors be. For colour the eye has no such fall (Mullen 1985): a coarse
    shift of hue is seen.
Expected
    With one policy for all channels a blue night sky over a warm building turns purple: its hue
    shifts by tens of degrees, as with subtraction. With a floor of 1 for chroma it shifts less
    than half as much.
"""

from __future__ import annotations

from compensate.aim import Aim
from compensate.pose import Eye, Stage
from compensate.solver.admm import ADMM
from compensate.vision.csf import LowFrequencyFloor
from compensate.weighting import PerceptualWeighting
from domesim.frames import Frame, Master
from domesim.scene import load_dome
from validation.experiment import Column, Finding, Table, Work, at_least, at_most
from validation.hue import shift_in_the_dark
from validation.masters import bundled_night


def measure(scene: str = "dome_imax", step: int = 1) -> dict[str, float]:
    """Mean shift of hue of the darker half of the bundled night, degrees, by what is projected.

    Hue is the angle of u'v' (CIE 1976) around the projector's white.

    `step` takes each step-th pixel of the master, for a quick look.
    """
    (whole,) = bundled_night().frames
    coarse = whole.pixels[::step, ::step]
    frame = Master((Frame(coarse, whole.path, whole.colour, whole.bits, whole.floating),))
    theatre = load_dome(scene)
    errors = {}
    weightings: dict[str, Eye] = {
        "one_policy": PerceptualWeighting(chroma_low_frequency=LowFrequencyFloor(0.1)),
        "chroma_floor_1": PerceptualWeighting(chroma_low_frequency=LowFrequencyFloor(1.0)),
        "contrast": Aim(),
    }
    for name, weighting in weightings.items():
        posed, _ = Stage(theatre, weighting).pose_frame(frame)
        lights = {name: ADMM()(posed.problem, posed.subtractive).light}
        if name == "one_policy":
            lights |= {"nothing": posed.desired, "subtractive": posed.subtractive}
        for what, light in lights.items():
            shift = shift_in_the_dark(posed.problem.desired, posed.seen(light), theatre)
            assert shift is not None
            errors[what] = shift
    return errors


def run(work: Work) -> Finding:
    """Measure, and say whether it is as expected."""
    step = 4 if work.quick else 1
    found = work.step(f"step {step}", dict[str, float], lambda: measure(step=step))
    names = {
        "nothing": "nothing",
        "subtractive": "exact subtraction",
        "one_policy": "perceptual, one floor of 0.1 for all channels",
        "chroma_floor_1": "perceptual, a floor of 1 for chroma (the default)",
        "contrast": "the master's contrasts (the default)",
    }
    ours = found["chroma_floor_1"]
    return Finding(
        result=(
            f"With one low-frequency floor of 0.1 for all channels (the paper has one curve for "
            f"all, without a floor) the dark half of the picture is seen "
            f"{found['one_policy']:.0f}° off in hue; with a floor of 1 for chroma, "
            f"{ours:.0f}°, with the master's contrasts, the default, "
            f"{found['contrast']:.0f}° (untouched {found['nothing']:.0f}°, subtraction "
            f"{found['subtractive']:.0f}°)."
        ),
        checks=(
            at_least("hue shift, one policy", found["one_policy"], 15, "°"),
            at_most("hue shift, chroma floor over one policy", ours / found["one_policy"], 0.5),
            at_most("hue shift, chroma floor over subtraction", ours / found["subtractive"], 0.5),
            at_most(
                "hue shift, the default over subtraction",
                found["contrast"] / found["subtractive"],
                0.25,
            ),
        ),
        tables=(
            Table(
                caption=(
                    f"Mean shift of hue of the darker half of the bundled night, in dome_imax"
                    f"{', every 4th pixel (quick)' if work.quick else ''}. Hue: angle in u'v' "
                    f"around projector white."
                ),
                columns=(
                    Column(name="compensation"),
                    Column(name="hue shift", unit="°", digits=".1f"),
                ),
                rows=tuple((name, found[key]) for key, name in names.items()),
            ),
        ),
        figures={f"chroma_floor.{name}": shift for name, shift in found.items()},
    )
