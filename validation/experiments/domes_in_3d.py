"""In a 3D dome reflected light must be answered first, and polarised light finds the wrong eye.

Rationale
    A 3D dome reflects each view, and each view leaks to the other eye. The closed form
    (`domesim.observation.dome_pair`) takes the sum of the views as any light, and has each
    reflection keep a share k of their difference. Here polarised light is traced in bare domes with
    Mitsuba's Mueller matrices (`domesim.pathtrace.polarised_dome`): off matt paint that keeps 1,
    0.7 or none of circular polarisation and turns its hand, as metal does, so that k is -1, -0.7
    and 0; and off facets of aluminium, where no closed form holds, to see what k they have. Of
    shutters and spectral filters (k = 1) each view's light is traced in colour as any dome's, and
    crosstalk follows. Then pairs of domemasters are compensated in the two bundled scenes, of 0.5
    and 2 % crosstalk, for both pollutions, for one of them only, and for none. What is seen is
    judged: light traced in the theatre, with the bounces of either view shared out between the
    eyes.
Expected
    Traced intensities and circular parts are the closed form's: no bias of places, and means within
    1e-3 of white. Off aluminium the hand is turned: k lies between -1 and -0.2. Traced colour
    pictures are within 1e-3 of white (rms) of closed form times crosstalk. No pair is seen brighter
    than untouched. In the mean of the pairs it costs a difference that counts, 0.02 JOD, to leave
    reflected light as it is (0.1 of the default before, which lifted more), and less than that to
    leave crosstalk: a model of one eye minds such ghosts little. But then all of the ghost is
    there, and none where both are answered: over a lifted black it can be subtracted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias, final

import numpy as np
from scipy.ndimage import map_coordinates

from compensate.ghosts import ghost_left
from compensate.master import compensate
from compensate.ruler import NO_DIFFERENCE, Ruler
from domesim.light import Light
from domesim.observation.crosstalk import Crosstalk
from domesim.observation.spherical import closed_form_gain
from domesim.pathtrace.layers import layers_of
from domesim.pathtrace.observation import PathTracedDome
from domesim.pathtrace.polarised_dome import polarised_dome
from domesim.pathtrace.tracer import Settings
from domesim.pathtrace.two_eyes import seen_by_eyes
from domesim.room.dome import Dome
from domesim.scene import DomeScene, load_dome
from domesim.stereo.system import SilverScreen
from testing.statistics import FALSE_ALARM, bias_p
from validation.data import FOLDER
from validation.experiment import (
    Check,
    Column,
    Finding,
    Table,
    Work,
    at_least,
    at_most,
    between,
    require_tracer,
)
from validation.inputs import DOME_SIZE, orrery, wanted

SCENES = ("dome_stereo_spectral", "dome_stereo_polarised")
RADIUS, ALBEDO = 5.0, 0.5
LENS, EYE = (0.4, 0.3, 2.0), (-0.6, -0.5, 2.2)
"""Off the axis, so that the screen is lit unevenly; m, in the dome's frame."""
HALF_ANGLES = (90.0, 75.0)
KEPT = (-1.0, -0.7, 0.0)
SILVER: Mapping[str, SilverScreen] = {
    f"roughness {rough:g}, {share:.1%} matt": SilverScreen(1.0, 1.0, share, rough, 0.6)
    for rough in (0.2, 0.35, 0.5)
    for share in (0.0, 0.025, 0.08)
}
_GROUP = 512  # neighbouring places
DISPARITY = np.radians(0.4)
"""Between the eyes, of what is at infinity, where the screen is 9 m away."""

SKIES = ("night", "Milky Way")
BOTH, REFLECTED_ONLY = "both", "reflected light only"
CROSSTALK_ONLY, NOTHING = "crosstalk only", "nothing"
WAYS = (BOTH, REFLECTED_ONLY, CROSSTALK_ONLY, NOTHING)
Two: TypeAlias = tuple[float, float]
"""A figure of intensity, and one of the circular part."""


@final
@dataclass(frozen=True)
class Paint:
    """Light off a screen, over the mean of direct light.

    Attributes
    ----------
    mean, error
        What is traced, and its standard error, of intensity and circular part.
    expected
        By the closed form.
    p
        Least p-value of being unbiased, by groups of places.
    """

    mean: Two
    error: Two
    expected: Two
    p: float

    @property
    def off(self) -> float:
        """Largest error of the means."""
        return float(np.abs(np.subtract(self.mean, self.expected)).max())


@final
@dataclass(frozen=True)
class Silver:
    """Light off facets of aluminium.

    Attributes
    ----------
    direct, reflected
        Circular part over intensity, of direct light and of what was reflected more than once.
    share
        Reflected light over direct light.
    """

    direct: float
    reflected: float
    share: float

    @property
    def crosstalk(self) -> float:
        """What ideal filters leave of the other eye's direct light."""
        return (1 - self.direct) / (1 + self.direct)

    @property
    def kept(self) -> float:
        """The k of a series of reflections that has this circular part in all.

        Reflected intensities are q + q² + ... = q / (1 - q), circular parts k q / (1 - k q).
        """
        ratio, q = self.reflected / self.direct, self.share / (1 + self.share)
        return ratio / (1 - q + ratio * q)


@final
@dataclass(frozen=True)
class Seen:
    """What is seen of a pair of domemasters.

    Attributes
    ----------
    error
        Rms of closed form times crosstalk against traced light, of the untouched pair, over white.
    lost
        Quality lost by way, JOD, of traced light.
    light
        Mean light that is seen, over the master's, by way.
    ghost
        Share of the ghost's edges that is left, by way (`compensate.ghosts.ghost_left`), with what
        the picture's own edges have in common with the ghost's.
    """

    error: float
    lost: dict[str, float]
    light: dict[str, float]
    ghost: dict[str, float]


def painted(half_angle: float, kept: float, samples: int, seed: int) -> Paint:
    """Matt paint that keeps a share of circular polarisation."""
    dome = Dome(RADIUS, np.radians(half_angle))
    places = _seen_places(dome, seed)
    found = polarised_dome(dome, (ALBEDO, kept), LENS, EYE, places, samples=samples, seed=seed)
    lit = _irradiance(places)
    flux = dome.screen_area * _irradiance(_places(dome, seed, 1 << 20)).mean()
    gains = [closed_form_gain(ALBEDO, RADIUS, dome.screen_area, k) for k in (1.0, kept)]
    # What a filter passes is half of the light; the eye's own hand is the turned one
    unit = ALBEDO / np.pi / 2
    expected = unit * np.stack([lit + gains[0] * flux, (lit + gains[1] * flux) * -kept], axis=1)
    white = float(np.mean(unit * lit))
    groups = [_grouped(each) / white for each in (found.all, expected)]
    error = np.sqrt(_grouped(found.error**2) / _GROUP) / white
    known = error > 1e-9  # of a paint that keeps none, nothing arrives
    p = min(bias_p(groups[0][known], error[known], groups[1][known]))
    means = [np.mean(group, axis=0) for group in groups]
    spread = np.sqrt(np.sum(error**2, axis=0)) / len(error)
    return Paint(_two(means[0]), _two(spread), _two(means[1]), p)


def silver(screen: SilverScreen, samples: int, seed: int) -> Silver:
    """Traces facets of aluminium, and matt paint between them."""
    dome = Dome(RADIUS, np.pi / 2)
    found = polarised_dome(
        dome, screen, LENS, EYE, _seen_places(dome, seed), samples=samples, seed=seed
    )
    direct, reflected = found.direct.mean(axis=0), (found.all - found.direct).mean(axis=0)
    first, later = direct[1] / direct[0], reflected[1] / reflected[0]
    return Silver(float(first), float(later), float(reflected[0] / direct[0]))


def _grouped(values: Light) -> Light:
    """(group, 2) means over neighbouring places."""
    return np.asarray(values.reshape(-1, _GROUP, values.shape[-1]).mean(axis=1))


def _places(dome: Dome, seed: int, count: int = 1 << 13) -> Light:
    """(place, xyz) even over the screen, from the rim up."""
    random = np.random.default_rng(seed)
    least = np.cos(dome.half_angle)
    height = least + (1 - least) * (np.arange(count) + random.random(count)) / count
    azimuth = 2 * np.pi * random.random(count)
    aside = np.sqrt(1 - height**2)
    directions = np.stack([aside * np.cos(azimuth), aside * np.sin(azimuth), height], axis=1)
    return np.asarray(dome.radius * directions)


def _seen_places(dome: Dome, seed: int) -> Light:
    """(place, xyz) without those behind the lens, in whole groups."""
    places = _places(dome, seed)
    way, lens = places - np.asarray(EYE), np.subtract(LENS, EYE)
    along = way @ lens / np.linalg.norm(way, axis=1) / np.linalg.norm(lens)
    seen = places[along < np.cos(np.radians(6))]
    return seen[: len(seen) // _GROUP * _GROUP]


def _irradiance(places: Light) -> Light:
    """(place,) of a lens of unit intensity."""
    way = places - np.asarray(LENS)
    square = np.sum(way**2, axis=1)
    return np.asarray(np.sum(way * places, axis=1) / RADIUS / square**1.5)


def _two(values: Light) -> Two:
    return float(values[0]), float(values[1])


def turned(light: Light, angle: float) -> Light:
    """A domemaster of what is at infinity, turned about its middle; (1, row, col, primary)."""
    size = light.shape[1]
    rows, cols = np.mgrid[:size, :size] - (size - 1) / 2
    at = np.cos(angle) * rows - np.sin(angle) * cols, np.sin(angle) * rows + np.cos(angle) * cols
    where = [each + (size - 1) / 2 for each in at]
    planes = [map_coordinates(light[0, :, :, p], where, order=1, mode="nearest") for p in range(3)]
    return np.stack(planes, axis=-1)[None]


def at_infinity(read: Callable[[], Light]) -> Light:
    """A pair of a domemaster that is far away."""
    light = read()
    return np.concatenate([turned(light, half * DISPARITY / 2) for half in (1, -1)])


def judged(read: Callable[[], Light], name: str, *, seed: int) -> Seen:
    """A pair in a scene, by all ways."""
    scene, given = load_dome(name), read()
    stereo = scene.stereo
    assert stereo is not None
    size = given.shape[1]
    screen = scene.screen(size, size)
    master = np.asarray(given * screen[None, :, :, None], np.float32)
    shown = {way: answered(master, scene, way) for way in WAYS}
    observation = scene.observation(size, size)
    wanted = observation.direct(master)
    ruler = Ruler(wanted, scene, screen)
    crosstalk = Crosstalk(size, size, stereo.leaks)
    density = scene.viewing.pixels_per_degree(size, size)
    weights = scene.projector.luminance_weights
    leaked = crosstalk.leaked(wanted) @ weights
    error, lost, light, ghost = 0.0, {}, {}, {}
    for way, sent in shown.items():
        seen = traced(sent, scene, seed)
        lost[way] = ruler.lost(seen.astype(np.float32))
        # By the closed form: noise of tracing has edges
        ghost[way] = ghost_left((observation.observe(sent) - wanted) @ weights, leaked, density)
        light[way] = float(seen[:, screen].mean() / wanted[:, screen].mean())
        if way == NOTHING:
            apart = (seen - observation.observe(sent))[:, screen]
            error = float(np.sqrt(np.mean(np.square(apart, dtype=np.float64))))
    return Seen(error, lost, light, ghost)


def answered(master: Light, scene: DomeScene, way: str) -> Light:
    """Light that answers one pollution, both or none."""
    if way == NOTHING:
        return master
    if way == REFLECTED_ONLY:
        alone = [compensate(master[v : v + 1], scene.one_eye).light for v in range(2)]
        return np.concatenate(alone)
    if way == CROSSTALK_ONLY:
        black = replace(scene.theatre, albedo=(0.0, 0.0, 0.0))
        scene = replace(scene, theatre=black)
    return compensate(master, scene).light


def traced(sent: Light, scene: DomeScene, seed: int) -> Light:
    """What both eyes see, traced; with the black of the scene."""
    stereo = scene.stereo
    assert stereo is not None
    rows, cols = sent.shape[1:3]
    settings = Settings(error=0.05, seed=seed, per_bounce=True)
    dome = PathTracedDome(scene.theatre, rows, cols, settings)
    left, right = (layers_of(dome.trace(sent[v : v + 1]), dome.screen) for v in range(2))
    seen = seen_by_eyes((left, right), stereo.kept, stereo.leaks)
    black = scene.ambient / scene.projector.white * dome.screen[..., None]
    return np.stack([each[""] + black for each in seen])


def run(work: Work) -> Finding:
    """Trace, and compensate."""
    require_tracer()
    samples = 8 if work.quick else 256
    paints = work.each(
        {f"half-angle {half:g}°, keeps {k:g}": (half, k) for half in HALF_ANGLES for k in KEPT},
        Paint,
        lambda given: painted(*given, samples, work.seed),
    )
    metals = work.each(SILVER, Silver, lambda screen: silver(screen, samples, work.seed))
    pairs, left_out = _pairs(work)
    seen = work.each(
        {f"{what} in {name}": (read, name) for what, read in pairs.items() for name in SCENES},
        Seen,
        lambda given: judged(*given, seed=work.seed),
    )
    kept = {name: metal.kept for name, metal in metals.items()}
    off = max(paint.off for paint in paints.values())
    losses = {way: [one.lost[way] - one.lost[BOTH] for one in seen.values()] for way in WAYS[1:]}
    return Finding(
        result=(
            f"Off matt paint, traced intensity and circular polarisation are the closed form's: "
            f"means are within {off:.1e} of white, and places within their errors. Off facets of "
            f"aluminium each reflection keeps {min(kept.values()):.2f} to {max(kept.values()):.2f} "
            f"of the circular polarisation: its hand is turned, and what is reflected is seen by "
            f"the wrong eye more than by its own. It does not just lose its polarisation. Traced "
            f"colour pictures are "
            f"within {max(one.error for one in seen.values()):.1e} of white (rms) of the closed "
            f"form times crosstalk.\n\nTo answer one pollution of two costs, over answering both: "
            + "; ".join(
                f"{way}, {np.mean(lost):+.3f} JOD ({min(lost):+.3f} to {max(lost):+.3f})"
                for way, lost in losses.items()
            )
            + "."
        ),
        checks=tuple(_checks(paints, kept, seen, losses, quick=work.quick)),
        tables=tuple(_tables(paints, metals, seen)),
        figures={
            "domes_in_3d.off": off,
            "domes_in_3d.colour": max(one.error for one in seen.values()),
            **{f"domes_in_3d.{way.split()[0]}": float(np.mean(losses[way])) for way in losses},
        },
        left_out=tuple(left_out),
    )


def _pairs(work: Work) -> tuple[dict[str, Callable[[], Light]], list[str]]:
    inputs, _ = wanted(work)
    found: dict[str, Callable[[], Light]] = {
        name: partial(at_infinity, inputs[name].read) for name in SKIES if name in inputs
    }
    if work.quick:
        return found, ["The orrery, and the photographed sky: with a full run"]
    left_out = [f"{name}: needs the test data; set {FOLDER}" for name in SKIES if name not in found]
    return {**found, "orrery": partial(orrery, "dome-stereo", DOME_SIZE)}, left_out


def _checks(
    paints: Mapping[str, Paint],
    kept: Mapping[str, float],
    seen: Mapping[str, Seen],
    losses: Mapping[str, list[float]],
    *,
    quick: bool,
) -> Iterator[Check]:
    least = min(paint.p for paint in paints.values())
    yield at_least("p of paints being unbiased, least of all", least, FALSE_ALARM / len(paints))
    if not quick:
        yield at_most(
            "means off paint, error over white", max(p.off for p in paints.values()), 1e-3
        )
    yield between("polarisation kept off aluminium, least", min(kept.values()), -1.0, -0.2)
    yield between("polarisation kept off aluminium, most", max(kept.values()), -1.0, -0.2)
    yield at_most(
        "traced colour pictures, rms error over white", max(o.error for o in seen.values()), 1e-3
    )
    brighter = max(one.light[BOTH] / one.light[NOTHING] for one in seen.values())
    yield at_most("light that is seen, both answered over untouched, most", brighter, 1.0)
    if quick:  # so small a picture has no details to lose
        return
    mean = {way: float(np.mean(lost)) for way, lost in losses.items()}
    for way in (CROSSTALK_ONLY, NOTHING):
        yield at_least(f"{way}: quality lost beyond both's, mean", mean[way], NO_DIFFERENCE, "JOD")
    what = f"{REFLECTED_ONLY}: quality lost beyond both's, mean"
    yield at_most(what, mean[REFLECTED_ONLY], NO_DIFFERENCE, "JOD")
    apart = [one.ghost[REFLECTED_ONLY] - one.ghost[BOTH] for one in seen.values()]
    yield between(
        "share of the ghost that answering crosstalk takes away, least", min(apart), 0.9, 1.1
    )
    yield between("the same, most", max(apart), 0.9, 1.1)


def _tables(
    paints: Mapping[str, Paint],
    metals: Mapping[str, Silver],
    seen: Mapping[str, Seen],
) -> Iterator[Table]:
    yield Table(
        caption="Light that arrives from a bare dome of matt paint, over the mean of direct light: "
        "intensity I, and circular part V with the eye's own hand above 0.",
        columns=(
            Column(name="dome and paint"),
            *(
                Column(name=f"{part}, {what}", digits=digits)
                for part in "IV"
                for what, digits in (("traced", ".5f"), ("±", ".1e"), ("closed form", ".5f"))
            ),
        ),
        rows=tuple(
            (name, *(x for k in range(2) for x in (p.mean[k], p.error[k], p.expected[k])))
            for name, p in paints.items()
        ),
    )
    yield Table(
        caption="Off a hemisphere of aluminium facets, with matt paint between them: circular part "
        "over intensity, of direct and of reflected light; reflected light over direct light; the "
        "crosstalk of direct light behind ideal filters; what each reflection keeps.",
        columns=(
            Column(name="screen"),
            Column(name="circular, direct", digits=".3f"),
            Column(name="circular, reflected", digits=".3f"),
            Column(name="reflected over direct", digits=".3f"),
            Column(name="crosstalk", unit="%", digits=".1f"),
            Column(name="k", digits=".2f"),
        ),
        rows=tuple(
            (name, one.direct, one.reflected, one.share, 100 * one.crosstalk, one.kept)
            for name, one in metals.items()
        ),
    )
    yield Table(
        caption="Quality lost (JOD, by ColorVideoVDP) of traced light, light that is seen over the "
        "master's, and the share of the ghost's edges that is left, with what lifted edges of the "
        "picture's own have in common with it, by what is answered.",
        columns=(
            Column(name="pair"),
            *(Column(name=f"lost, {way}", digits=".3f") for way in WAYS),
            *(Column(name=f"light, {way}", digits=".3f") for way in WAYS),
            *(Column(name=f"ghost, {way}", digits=".2f") for way in WAYS),
        ),
        rows=tuple(
            (name, *(figure[way] for figure in (one.lost, one.light, one.ghost) for way in WAYS))
            for name, one in seen.items()
        ),
    )
