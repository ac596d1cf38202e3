"""Headroom: how much of what its judge could give does the default take.

Rationale
    ColorVideoVDP is differentiable, and so is the theatre. Its gradient is climbed on domemasters
    of `quality` that nothing was chosen on, made small, in `dome_hemisphere` with an albedo of 0.5
    and a white of 15 cd/m². The light is a square, so that none is negative, at most white. Adam
    starts from the default or from subtraction, whichever the judge prefers, and a hinge keeps
    Delta E ITP at the default's or below: whoever climbs one judge alone finds what only that judge
    likes. The best light that obeys is the *oracle*. It is a lower estimate of what can be had, and
    it has seen its judge's answers, which no method may. It is climbed with pixels as they are,
    and judged as all pictures are (`judges.enlarged`), which takes ten times as long.

    Left free, it dims what is bright, tenfold and more, for the judge compares each picture with
    its own light, and pollution falls with the picture. So there are two: one free, and one that
    keeps the light that subtraction shows exactly, as every method here must: in the median 0.98
    of it, and 0.9 in the 5th percentile.
Expected
    Over the better of nothing and subtraction, the default takes at least 60 % of what the oracle
    takes that keeps light, in the mean of the inputs. No oracle is below the default, and none has
    more Delta E ITP.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from compensate.aim import Aim
from compensate.pose import Posed, pose
from compensate.solve import solved
from domesim.light import Light
from domesim.observation.base import AdjointObservation
from domesim.observation.projector import conversion
from domesim.scene import Scene
from validation.experiment import (
    Check,
    Column,
    Finding,
    Missing,
    Table,
    Work,
    at_least,
    at_most,
)
from validation.inputs import (
    USUAL_ALBEDO,
    USUAL_LUMINANCE,
    Input,
    dome_at,
    reported_domemasters,
)
from validation.judges import climbable, colorvideovdp
from validation.pairs import no_wider
from validation.panel import delta_e_itp
from validation.seen import exact

INPUTS = ("Milky Way", "Stellarium", "planetary limb", "underwater")
"""Inputs of a full run."""

SIZE = 192
"""Side of a picture, pixels."""
STEPS, RATE = 200, 0.05
"""Steps of Adam and their first rate, of the light's square root; it falls to a tenth."""
HINGE = 20.0
"""JOD that a Delta E ITP twice the default's costs."""
SHARE = 0.6
"""Share of what can be had that the default should take."""
KEPT, KEPT_FIFTH = 0.98, 0.9
"""Light over the master's that is kept where subtraction is exact: median, and 5th percentile."""
_NEAR = 1e-3
"""Delta E ITP above the default's that counts as the same, relative."""
_DARKEST = 1e-7
"""Light whose square root has a slope; of white."""
# Rec. ITU-R BT.2100-2, tables 4 (PQ) and 7 (ICtCp)
_LMS: NDArray[np.float64] = np.array([[1688, 2146, 262], [683, 2951, 462], [99, 309, 3688]]) / 4096
_ICTCP: NDArray[np.float64] = (
    np.array([[2048, 2048, 0], [6610, -13613, 7003], [17933, -17390, -543]]) / 4096
)
_M1, _M2, _C1, _C2, _C3 = 2610 / 16384, 2523 / 32, 3424 / 4096, 2413 / 128, 2392 / 128


@final
@dataclass(frozen=True)
class Climb:
    """JOD and Delta E ITP of one input.

    Attributes
    ----------
    nothing, subtraction, default, oracle, free
        JOD; `oracle` keeps light, and `free` need not.
    default_difference, oracle_difference
        Delta E ITP.
    """

    nothing: float
    subtraction: float
    default: float
    oracle: float
    free: float
    default_difference: float
    oracle_difference: float

    @property
    def had(self) -> float:
        """What the oracle gains over the better of nothing and subtraction."""
        return self.oracle - max(self.nothing, self.subtraction)

    @property
    def had_freely(self) -> float:
        """What the free one gains."""
        return self.free - max(self.nothing, self.subtraction)

    @property
    def taken(self) -> float:
        """What the default gains."""
        return self.default - max(self.nothing, self.subtraction)


def climb(read: Input, size: int = SIZE, steps: int = STEPS) -> Climb:
    """One input."""
    light = no_wider(read.read(), size).astype(np.float32)
    posed = pose(light, dome_at(USUAL_ALBEDO, USUAL_LUMINANCE), Aim())
    ways = (posed.desired, posed.subtractive, solved(posed, "perceptual").light)

    def jod(light: Light) -> float:
        return colorvideovdp(posed.wanted, posed.seen(light), posed.scene)

    def difference(light: Light) -> float:
        return delta_e_itp(posed.wanted, posed.seen(light), posed.scene)

    nothing, subtraction, default = (jod(each) for each in ways)
    limit = difference(ways[2])
    start = ways[2] if default >= subtraction else ways[1]
    free = climbed(posed, start, limit, steps)
    oracle = climbed(posed, start, limit, steps, keeps=True)
    return Climb(nothing, subtraction, default, jod(oracle), jod(free), limit, difference(oracle))


def climbed(posed: Posed, start: Light, limit: float, steps: int, *, keeps: bool = False) -> Light:
    """The light that the judge likes best of all that Adam comes by, at most `limit` different.

    If it `keeps` light, only such that `KEPT` and `KEPT_FIFTH` hold.
    """
    torch, judge = climbable(posed.wanted, posed.scene)
    differ = _difference(torch, posed.wanted, posed.scene)
    assert isinstance(posed.observation, AdjointObservation)
    seen = _seen(torch, posed.observation)
    upper = float(np.sqrt(np.max(posed.single.upper)))
    kept = _kept(torch, posed) if keeps else lambda _: torch.ones(1)
    root = torch.tensor(np.sqrt(np.maximum(start, _DARKEST)), requires_grad=True)
    adam = torch.optim.Adam([root], lr=RATE)
    best, light = -np.inf, start
    for step in range(steps + 1):
        for group in adam.param_groups:
            group["lr"] = RATE * 0.1 ** (step / steps)
        shown = seen(root**2)
        jod, off = judge(shown), differ(shown)
        share = kept(shown)
        obeys = share.median() >= KEPT and share.quantile(0.05) >= KEPT_FIFTH
        if off.item() <= limit * (1 + _NEAR) and obeys and jod.item() > best:
            best, light = jod.item(), (root.detach() ** 2).numpy().copy()
        adam.zero_grad()
        lost = torch.relu(1 - share).mean()
        (HINGE * (torch.relu(off / limit - 1) + lost) - jod).backward()
        adam.step()
        with torch.no_grad():
            root.clamp_(_DARKEST**0.5, upper)
    return np.where(posed.screen[..., None], light, start)


def _seen(torch: Any, observation: AdjointObservation) -> Callable[[Any], Any]:
    """What is seen of light, with its adjoint for torch."""

    class Seen(torch.autograd.Function):  # type: ignore[misc]
        @staticmethod
        def forward(_: Any, light: Any) -> Any:
            return torch.from_numpy(observation.observe(light.detach().numpy()))

        @staticmethod
        def backward(_: Any, slope: Any) -> Any:
            return torch.from_numpy(observation.adjoint(slope.contiguous().numpy()))

    return Seen.apply  # type: ignore[no-any-return]


def _kept(torch: Any, posed: Posed) -> Callable[[Any], Any]:
    """(pixel,) luminance over the master's where subtraction is exact and not black, for torch."""
    place = torch.from_numpy(exact(posed.wanted, posed.shown, posed.scene))
    weights = torch.tensor(posed.scene.projector.luminance_weights, dtype=torch.float32)
    there = (torch.tensor(posed.wanted) @ weights)[place]
    if not len(there):
        return lambda light: torch.ones(1)
    return lambda light: (light @ weights)[place] / there


def _difference(torch: Any, reference: Light, scene: Scene) -> Callable[[Any], Any]:
    """`delta_e_itp` of what is seen, for torch."""
    inside = scene.screen(*reference.shape[1:3])
    areas = torch.tensor((scene.pixel_areas(*inside.shape) * inside)[inside], dtype=torch.float32)
    to_709 = scene.projector.to_display(np.eye(3))
    to_lms = conversion("BT.709", "BT.2020").T @ _LMS.T
    first, then, last = (
        torch.tensor(each, dtype=torch.float32) for each in (to_709, to_lms, _ICTCP.T)
    )
    weights = torch.tensor([1.0, 0.25, 1.0])

    def coded(light: Any) -> Any:
        display = torch.clamp(light[0][inside] @ first, min=0) * scene.projector.white
        power = (torch.clamp(display @ then, min=1e-6) / 10_000) ** _M1
        return ((_C1 + _C2 * power) / (1 + _C3 * power)) ** _M2 @ last

    wanted = coded(torch.tensor(np.asarray(reference, np.float32)))

    def difference(light: Any) -> Any:
        square = ((coded(light) - wanted) ** 2 * weights).sum(-1)
        return 720 * (torch.sqrt(square + 1e-14) * areas).sum() / areas.sum()

    return difference


def run(work: Work) -> Finding:
    """Climb each."""
    if work.quick:
        raise Missing("takes minutes: with a full run")
    inputs, left_out = reported_domemasters(work)
    found = work.each({name: one for name, one in inputs.items() if name in INPUTS}, Climb, climb)
    had, free, taken = (
        float(np.mean([getattr(each, name) for each in found.values()]))
        for name in ("had", "had_freely", "taken")
    )
    return Finding(
        result=(
            f"Climbing ColorVideoVDP's own gradient, at no more Delta E ITP than the default has, "
            f"gains {had:+.2f} JOD over the better of nothing and subtraction, mean of "
            f"{len(found)} domemasters of {SIZE} pixels, where what subtraction shows exactly "
            f"keeps its light, and {free:+.2f} JOD where it need not: that dims the whole picture. "
            f"The default gains {taken:+.2f} JOD, {taken / had:.0%} and {taken / free:.0%} of that."
        ),
        checks=tuple(_checks(found, taken / had)),
        tables=(_table(found),),
        figures={
            "headroom.had": had,
            "headroom.share": taken / had,
            "headroom.share_of_free": taken / free,
        },
        left_out=tuple(left_out),
    )


def _checks(found: Mapping[str, Climb], share: float) -> Iterator[Check]:
    yield at_least("share of what can be had that the default takes", share, SHARE)
    yield at_least(
        "gain of the oracle over the default, least",
        min(each.oracle - each.default for each in found.values()),
        0.0,
        "JOD",
    )
    yield at_most(
        "its Delta E ITP over the default's, largest",
        max(each.oracle_difference / each.default_difference for each in found.values()),
        1 + 2 * _NEAR,
    )


def _table(found: Mapping[str, Climb]) -> Table:
    return Table(
        caption="ColorVideoVDP's JOD, 10 is the master, and the default's share of what the oracle "
        "gains over the better of nothing and subtraction.",
        columns=(
            Column(name="input"),
            *(
                Column(name=name, digits=".2f")
                for name in ("nothing", "subtraction", "default", "oracle", "free")
            ),
            Column(name="the default's share", unit="%", digits=".0f"),
            Column(name="Delta E ITP of the default", digits=".2f"),
            Column(name="of the oracle", digits=".2f"),
        ),
        rows=tuple(
            (
                name,
                each.nothing,
                each.subtraction,
                each.default,
                each.oracle,
                each.free,
                100 * each.taken / each.had,
                each.default_difference,
                each.oracle_difference,
            )
            for name, each in found.items()
        ),
    )
