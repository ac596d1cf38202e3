"""Quality: which method shows what is wanted best, by two judges that no objective knows.

Rationale
    Stereo pairs in `stereo_polarised_paper` with crosstalk of 1, 2, 5 and 10 %, and domemasters in
    `dome_hemisphere` with albedos of 0.3, 0.5 and 0.7, each at a white of 5, 15 and 48 cd/m², a
    black of 1/2000 of it (the least sequential contrast of SMPTE RP 431-2's reference projector)
    and an adaptation to 1/10 of it (chosen, as in the scenes). Every method knows the pollution
    exactly. What is seen is compared with the master by ColorVideoVDP and by FLIP. For pairs there
    is the *ghost contour*, for the paper's reason to compensate is that conflicting edges hinder
    fusion: with e and g the luminance that is seen too much, now and of the untouched master, C =
    sqrt(sum (grad e . n)² / sum (grad g . n)²), n = grad g / |grad g|: the slopes of the error
    across the edges of the other eye's picture, 1 if nothing is done and 0 if none of them is left;
    an edge that is overcorrected counts as one that is left. Gradients are of planes smoothed as
    for the ghost edge energy (`compensate.ghosts`). The sums go over edges where subtraction
    clips: of the pixels where it shows more light than is wanted in some primary, the fewest that
    hold nine tenths of the sum of |grad g|² there. It is given of light, and of contrast: of log(Y
    + 0.01) in place of the luminance Y (1 = white), which forgives what a veil hides. A *new
    artefact* is a place where ColorVideoVDP's heatmap has lost 0.5 JOD more than with subtraction
    and more than with nothing. Pictures are averaged down by whole numbers of
    pixels, and seen as large as the screen: with 10 pixels a degree at most, finer ringing cannot
    be seen. Inputs are the sample: gains are averaged over an input's pollutions and luminances
    first, and intervals are Student's over inputs. Pollutions and luminances weigh alike.
Expected
    Where subtraction leaves what is seen (its JOD is below 9.9), weighting local contrast gains at
    least 0.1 JOD over it on average, and the 95 % interval of the gain lies above 0; no frame is
    more than 0.02 JOD below the better of subtraction and nothing; the ghost contour where
    subtraction clips falls to half of subtraction's; new artefacts cover at most 1 % of any
    screen. Two laws hold whatever judges say: what minimises a visible error has the least of all,
    well below subtraction's, and within its certified gap of 1e-3.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.ndimage import gaussian_filter, uniform_filter

from compensate.contrast import ContrastWeighting, Eye
from compensate.ghosts import BEST_FREQUENCY, FINEST_SIGMA
from compensate.master import Posed, pose, solved
from compensate.solver.result import Status
from compensate.vision.csf import LowFrequencyFloor
from compensate.weighting import PerceptualWeighting
from domesim.frames import Master, read_master
from domesim.light import Light
from domesim.observation.crosstalk import leak_matrices
from domesim.scene import DomeScene, Scene, StereoScene, load_scene
from domesim.screening import decoded, within_range
from domesim.transfer import named
from validation import drawing, judges, masters, pairs
from validation.experiment import Cell as Entry
from validation.experiment import (
    Check,
    Column,
    Finding,
    Missing,
    Panel,
    Pictures,
    Plot,
    Table,
    Work,
    at_least,
    at_most,
)

STEREO_SCENE, DOME_SCENE = "stereo_polarised_paper", "dome_hemisphere"
CROSSTALK = (0.01, 0.02, 0.05, 0.1)
"""Shares of light that reach the other eye."""
ALBEDOS = (0.3, 0.5, 0.7)
LUMINANCES = (5.0, 15.0, 48.0)
"""Of white, cd/m²: a giant dome's, a planetarium's that is bright, a cinema's."""
USUAL_CROSSTALK, USUAL_ALBEDO, USUAL_LUMINANCE = 0.05, 0.5, 15.0
"""Of pictures; and the luminance that variants are tried at."""
SEQUENTIAL_CONTRAST = 2000.0
"""White over black: the least of the reference projector in SMPTE RP 431-2:2011 (doi
10.5594/SMPTE.RP431-2.2011), which allows theatres less."""
ADAPTATION = 0.1
"""Adaptation luminance, of white."""
PAIRS = ("trunks", "fog", "motorcycle", pairs.SEQUENCE[0])
"""Of the test data."""
DOMES: Mapping[str, str] = {
    "full dome": "dm3d_fulldome_2K.jpg",
    "pillars": "dm3d_pillars_hdr_512.exr",
}
"""Domemasters of the test data."""
WIDEST = 512
"""Pixels."""
QUICK_WIDTH, QUICK_SIZE = 96, 64
"""Of the pair and the domemaster of a quick run."""

VISIBLE = 9.9
"""JOD of subtraction below which something is left to gain."""
SHORT = 0.02
"""JOD that a frame may fall short of the better of subtraction and nothing."""
NEW = 0.5
"""JOD that a place loses over the worse of subtraction and nothing, to count as a new artefact."""
MOST_NEW = 0.01
"""Share of the screen that new artefacts may have."""
EDGES = 0.9
"""Share of the ghost's squared slopes that its edges hold."""
FAINTEST = 0.01
"""Light, of white, far below which the eye has no contrast beside brighter light."""
TOO_BRIGHT_BY = 1e-5
"""Light that subtraction leaves where it clips; less is rounding."""
LOST = 3.0
"""JOD that a heatmap shows as its brightest."""
DARK = 0.02
"""Light, below which ghosts stand out."""
BRIGHTER = (10, 5, 2)
"""How many times brighter than they are the pictures are shown: the first that is not too much."""
TOO_BRIGHT = 0.25
"""Share of a picture that may be shown white."""


@final
@dataclass(frozen=True)
class Way:
    """What to project: one of `compensate.methods`, with a vision model.

    Parameters
    ----------
    title
        What it is called.
    method
        Its method.
    eye
        Its vision model.
    """

    title: str
    method: str
    eye: Eye

    @staticmethod
    def plain(title: str, method: str) -> Way:
        """One that asks no vision model."""
        return Way(title, method, PerceptualWeighting())

    @staticmethod
    def uniform(gain: float) -> Way:
        """The paper's weighting."""
        eye = PerceptualWeighting(LowFrequencyFloor(gain))
        return Way(f"the paper's weighting, {gain:g}", "perceptual", eye)

    @staticmethod
    def local(title: str, **settings: Any) -> Way:
        """Weighting of local contrast."""
        return Way(title, "perceptual", ContrastWeighting(**settings))


CHOSEN = "contrast"
"""Of `MAIN`: what is to become the default."""

MAIN: Mapping[str, Way] = {
    "none": Way.plain("nothing", "none"),
    "subtractive": Way.plain("subtraction", "subtractive"),
    "raised-black": Way.plain("range compression", "raised-black"),
    "uniform 0.1": Way.uniform(0.1),
    "uniform 0.3": Way.uniform(0.3),
    CHOSEN: Way.local("local contrast"),
}
"""Tried everywhere."""

VARIANTS: Mapping[str, Way] = {
    way.title: way
    for way in (
        *(
            Way.local(f"low-frequency gain {gain:g}", low_frequency=LowFrequencyFloor(gain))
            for gain in (0.1, 0.3)
        ),
        Way.local("chromatic low-frequency gain 0.2", chroma_low_frequency=LowFrequencyFloor(0.2)),
        *(Way.local(f"floor {floor:g} cd/m²", floor=floor) for floor in (0.03, 0.3)),
        *(Way.local(f"reach {reach:g}°", reach=reach) for reach in (0.0, 0.5)),
        *(Way.local(f"most {most:g} of the adaptation", most=most) for most in (1.0, np.inf)),
    )
}
"""Tried at the usual luminance."""

WAYS: Mapping[str, Way] = {**MAIN, **VARIANTS}
SHOWN = ("none", "subtractive", "uniform 0.1", CHOSEN)
"""In pictures."""

Floats = NDArray[np.float64]
Place: TypeAlias = tuple[str, float, float]
"""Name of an input, its pollution, its luminance."""
Cells: TypeAlias = Mapping[Place, Mapping[str, "Cell"]]


@final
@dataclass(frozen=True)
class Input:
    """A master, and where it is shown.

    Parameters
    ----------
    read
        Its light.
    scene
        The scene of a pollution and a luminance of white, cd/m².
    pollutions
        To try.
    usual
        The one of pictures.
    """

    read: Callable[[], Light]
    scene: Callable[[float, float], Scene]
    pollutions: Sequence[float]
    usual: float


@final
@dataclass(frozen=True)
class Cell:
    """What one way does for an input at one place.

    Parameters
    ----------
    clipped
        Share of pixels that subtraction clips.
    error
        Visible error as the chosen weighting counts it, JND rms.
    flip, quality
        FLIP, and ColorVideoVDP in JOD: means of both eyes; None if not installed.
    contour, contrast_contour
        Ghost contours where subtraction clips, of light and of contrast; None without one.
    seconds
        Of the solution.
    status
        Name of the solver's `Status`.
    gap
        Certified.
    new
        Share of the screen that is worse by `NEW` than with subtraction and with nothing, as the
        heatmap has it; None if not installed.
    panels
        What is seen, and the heatmap, of the left eye's dark crop or of the domemaster.
    """

    clipped: float
    error: float
    flip: float | None
    quality: float | None
    contour: float | None
    contrast_contour: float | None
    seconds: float
    status: str
    gap: float | None
    new: float | None
    panels: tuple[Panel, ...]


def stereo_at(crosstalk: float, white: float) -> StereoScene:
    """The stereo scene with that crosstalk at all seats, and that bright."""
    scene = load_scene(STEREO_SCENE)
    assert isinstance(scene, StereoScene)
    matrices, black = leak_matrices(crosstalk), white / SEQUENTIAL_CONTRAST
    return replace(
        scene,
        projector=replace(scene.projector, white=white, black=black),
        ambient=np.full((2, 3), black),
        viewing=replace(scene.viewing, adaptation=ADAPTATION * white),
        seats={name: replace(seat, matrices=matrices) for name, seat in scene.seats.items()},
    )


def dome_at(albedo: float, white: float) -> DomeScene:
    """The dome with that albedo for all primaries, and that bright."""
    scene = load_scene(DOME_SCENE)
    assert isinstance(scene, DomeScene)
    black = white / SEQUENTIAL_CONTRAST
    return replace(
        scene,
        theatre=replace(scene.theatre, albedo=(albedo,) * 3),
        projector=replace(scene.projector, white=white, black=black),
        ambient=black,
        viewing=replace(scene.viewing, adaptation=ADAPTATION * white),
    )


@final
class Case:
    """An input at one place, and what its ways have in common."""

    def __init__(self, light: Callable[[], Light], scene: Scene) -> None:
        self._light, self.scene = light, scene
        self._posed: dict[str, Posed] = {}

    def posed(self, eye: Eye) -> Posed:
        """The input as a problem of a vision model."""
        key = repr(eye)
        if key not in self._posed:
            self._posed[key] = pose(self._light(), self.scene, eye)
        return self._posed[key]

    @property
    def plain(self) -> Posed:
        """By the chosen weighting."""
        return self.posed(WAYS[CHOSEN].eye)

    @property
    def desired(self) -> Light:
        """What should be seen."""
        desired: Light = self.plain.problem.desired
        return desired

    @cached_property
    def clipped(self) -> NDArray[np.bool_]:
        """(view, row, col): where subtraction shows more than is wanted."""
        left = self.plain.residual(self.plain.subtractive)
        found: NDArray[np.bool_] = np.any(left > TOO_BRIGHT_BY, axis=-1)
        return found

    @cached_property
    def usual_loss(self) -> NDArray[np.float32]:
        """(view, row, col) JOD that is lost by the worse of subtraction and nothing."""
        lights = (self.plain.subtractive, self.plain.desired)
        return np.maximum(*(self.judged(self.plain.seen(light))[1] for light in lights))

    def judged(self, seen: Light) -> tuple[float, NDArray[np.float32]]:
        """JOD of what is seen, and (view, row, col) what of it is lost where."""
        return judges.colorvideovdp_map(self.desired, seen, self.scene)

    def contours(self, light: Light) -> tuple[float | None, float | None]:
        """Ghost contours of what is projected, of light and of contrast.

        None of a dome, and without a ghost.
        """
        if self.scene.views == 1:
            return None, None
        posed = self.plain
        density = self.scene.viewing.pixels_per_degree(*posed.screen.shape)
        master, shown, untouched = (
            _luminance(seen, self.scene)
            for seen in (self.desired, posed.seen(light), posed.seen(posed.desired))
        )
        of_light = ghost_contour(shown - master, untouched - master, self.clipped, density)
        master, shown, untouched = (np.log(y + FAINTEST) for y in (master, shown, untouched))
        of_contrast = ghost_contour(shown - master, untouched - master, self.clipped, density)
        return of_light, of_contrast


def ghost_contour(
    error: Floats, ghost: Floats, where: NDArray[np.bool_], pixels_per_degree: float
) -> float | None:
    """C of the docstring; None where the ghost has no edges.

    Parameters
    ----------
    error, ghost
        (view, row, col) luminance that is seen too much: now, and of the untouched master.
    where
        (view, row, col) pixels of which the edges are taken.
    pixels_per_degree
        As the audience sees it.
    """
    sigma = max(FINEST_SIGMA, pixels_per_degree / (2 * np.pi * BEST_FREQUENCY))
    edges, slopes = (
        np.stack([_slope(plane, sigma, axis) for axis in (1, 2)]) for plane in (ghost, error)
    )
    strength = np.sum(edges**2, axis=0)
    inside = np.sort(strength[where])[::-1]
    if not np.any(inside > 0):
        return None
    sums = np.cumsum(inside)
    weakest = inside[np.searchsorted(sums, EDGES * sums[-1])]
    at = where & (strength >= weakest)
    across = np.sum(edges * slopes, axis=0)[at] ** 2 / strength[at]
    return float(np.sqrt(across.sum() / strength[at].sum()))


def measure(case: Case, way: Way, *, pictures: bool = False) -> Cell:
    """One way at one place.

    Parameters
    ----------
    case
        The input there.
    way
        What to project.
    pictures
        Whether pictures and the heatmap are wanted.
    """
    posed = case.posed(way.eye)
    begin = time.perf_counter()
    result = solved(posed, way.method)
    seconds = time.perf_counter() - begin
    seen, scene = posed.seen(result.light), case.scene
    panels = [_panel(case, seen, way.title)] if pictures else []
    quality, new = None, None
    try:
        quality, loss = case.judged(seen)
    except Missing:
        pass  # said in `left_out`
    else:
        new = float(np.mean((loss > case.usual_loss + NEW)[:, posed.screen]))
        if pictures:
            panels.append(_heat(case, loss, f"{way.title}: lost"))
    contour, contrast_contour = case.contours(result.light)
    return Cell(
        clipped=posed.clipped,
        error=case.plain.visible_error(result.light),
        flip=_flip(case.desired, seen, scene),
        quality=quality,
        contour=contour,
        contrast_contour=contrast_contour,
        seconds=seconds,
        status=result.status.name,
        gap=result.gap,
        new=new,
        panels=tuple(panels),
    )


def run(work: Work) -> Finding:
    """Every way for every input at every place."""
    wanted, left_out = _wanted(work)
    luminances = (USUAL_LUMINANCE,) if work.quick else LUMINANCES
    cells: dict[Place, dict[str, Cell]] = {}
    pictures: list[Pictures] = []
    for name, one in wanted.items():
        light = cache(one.read)
        for pollution in one.pollutions:
            for white in luminances:
                case = cache(partial(_case, light, one, pollution, white))
                place = (name, pollution, white)
                shown = (pollution, white) == (one.usual, USUAL_LUMINANCE)
                cells[place] = _measured(work, place, case, pictures=shown)
                if shown:
                    title = f"{_words(place)}: master"
                    master, brighter = work.step(title, tuple[Panel, int], partial(_master, case))
                    pictures.append(_pictures(place, one, master, brighter, cells[place]))
    every = [cell for ways in cells.values() for cell in ways.values()]
    if any(cell.flip is None for cell in every):
        left_out.append("FLIP: it needs pip install 'domesim[metrics]'")
    judged = all(cell.quality is not None for cell in every)
    if not judged:
        left_out.append("ColorVideoVDP: it needs pip install 'domesim[metrics]'")
    if work.quick:
        left_out.append("What is expected of the judges: with a full run; two inputs say nothing")
    checks = list(_laws(cells))
    if judged and not work.quick:
        checks += _expectations(cells, wanted)
    return Finding(
        result=_result(cells, wanted, judged=judged),
        checks=tuple(checks),
        tables=tuple(_tables(cells, wanted, judged=judged)),
        plots=tuple(_plots(cells, wanted)) if judged else (),
        pictures=tuple(pictures),
        figures=_figures(cells),
        left_out=tuple(left_out),
    )


# What is measured.


def _measured(
    work: Work, place: Place, case: Callable[[], Case], *, pictures: bool
) -> dict[str, Cell]:
    """Every way at a place, a step each."""

    def one(name: str) -> Cell:
        return measure(case(), WAYS[name], pictures=pictures and name in SHOWN)

    ways = WAYS if place[2] == USUAL_LUMINANCE else MAIN
    return {name: work.step(f"{_words(place)}: {name}", Cell, partial(one, name)) for name in ways}


def _case(light: Callable[[], Light], one: Input, pollution: float, white: float) -> Case:
    return Case(light, one.scene(pollution, white))


def _wanted(work: Work) -> tuple[Mapping[str, Input], list[str]]:
    """Inputs by name, and why others are not measured."""
    width = QUICK_WIDTH if work.quick else WIDEST
    size = QUICK_SIZE if work.quick else WIDEST
    generated = _of_pair(partial(pairs.generated, width, work.seed), quick=work.quick)
    night = _of_dome(partial(_domemaster, masters.bundled_night, size), quick=work.quick)
    if work.quick:
        return {"generated": generated, "night": night}, ["The test data: with a full run"]
    found: dict[str, Input] = {}
    left_out: list[str] = []
    for name in PAIRS:
        try:
            pairs.require(name)
        except Missing as missing:
            left_out.append(f"{name}: {missing}")
        else:
            found[name] = _of_pair(partial(_pair, name), quick=False)
    made = _of_dome(partial(masters.night, size, work.seed), quick=False)
    found |= {"generated": generated, "night": night, "generated dome": made}
    folder = _data() / "dome"
    for name, file in DOMES.items():
        if (folder / file).is_file():
            read = partial(read_master, [folder / file], repair=True)
            found[name] = _of_dome(partial(_domemaster, read, WIDEST), quick=False)
        else:
            left_out.append(f"{name}: needs {folder / file}; set {pairs.FOLDER}")
    return found, left_out


def _of_pair(read: Callable[[], Light], *, quick: bool) -> Input:
    return Input(read, stereo_at, (USUAL_CROSSTALK,) if quick else CROSSTALK, USUAL_CROSSTALK)


def _of_dome(read: Callable[[], Light], *, quick: bool) -> Input:
    return Input(read, dome_at, (USUAL_ALBEDO,) if quick else ALBEDOS, USUAL_ALBEDO)


def _pair(name: str) -> Light:
    """The pair, no wider than `WIDEST`."""
    light, _ = pairs.from_data(name, load_scene(STEREO_SCENE))
    return pairs.averaged(light, -(-light.shape[2] // WIDEST))


def _domemaster(read: Callable[[], Master], size: int) -> Light:
    """The domemaster, no wider than `size`."""
    scene = load_scene(DOME_SCENE)
    light = decoded(read(), scene)
    light = pairs.averaged(light, -(-light.shape[2] // size))
    return within_range(light, scene.screen(*light.shape[1:3]))[0]


def _data() -> Path:
    """The folder of the test data."""
    beside = Path(__file__).parents[3] / "shared" / "data"
    return Path(os.environ.get(pairs.FOLDER, beside))


def _flip(desired: Light, seen: Light, scene: Scene) -> float | None:
    try:
        return judges.flip(desired, seen, scene)
    except Missing:
        return None


def _slope(planes: Floats, sigma: float, axis: int) -> Floats:
    """(view, row, col) slopes of smoothed planes along an axis; borders are no edges."""
    order = [0, 0, 0]
    order[axis] = 1
    slopes: Floats = gaussian_filter(planes, (0, sigma, sigma), order=order, mode="nearest")
    return slopes


def _luminance(light: Light, scene: Scene) -> Floats:
    return np.asarray(np.asarray(light, np.float64) @ scene.projector.luminance_weights)


# Pictures: where it is dark, and subtraction leaves most.


def _window(case: Case) -> tuple[slice, slice]:
    """Of a pair, a square half as high as the picture; all of a domemaster."""
    posed = case.plain
    rows, cols = posed.screen.shape
    if case.scene.views == 1:
        return slice(rows), slice(cols)
    side = min(rows // 2, cols)
    master = _luminance(case.desired[:1], case.scene)[0]
    error = np.abs(_luminance(posed.residual(posed.subtractive)[:1], case.scene)[0])
    there = uniform_filter(error * (master < DARK), side, mode="constant")
    half = side // 2
    inside = there[half : rows - side + half + 1, half : cols - side + half + 1]
    row, col = np.unravel_index(int(np.argmax(inside)), inside.shape)
    return slice(int(row), int(row) + side), slice(int(col), int(col) + side)


def _panel(case: Case, light: Light, title: str) -> Panel:
    """The left eye's crop, as much brighter as all of the case are shown."""
    return _drawn(case, light[:1], title, 1 / _brighter(case))


def _heat(case: Case, loss: NDArray[np.float32], title: str) -> Panel:
    """The left eye's crop of a heatmap."""
    from matplotlib import colormaps  # noqa: PLC0415 (as in `drawing`)

    coloured = colormaps["inferno"](loss[:1] / LOST)[..., :3].astype(np.float32)
    return _drawn(case, named("srgb", white=1.0).decode(coloured), title, 1.0)


def _drawn(case: Case, light: Light, title: str, brightest: float) -> Panel:
    crop = light[:, *_window(case)]
    times = max(1, round(400 / crop.shape[1]))
    large = crop.repeat(times, axis=1).repeat(times, axis=2)
    made = drawing.pictures("", {title: large}, case.scene, brightest=brightest)
    what = "Domemaster" if case.scene.views == 1 else "Left eye, dark crop"
    return made.panels[0].model_copy(update={"alt": f"{what}: {title}"})


def _brighter(case: Case) -> int:
    """How many times brighter the crop is shown."""
    crop = case.desired[0, *_window(case)]
    white = ((times, np.mean(np.max(crop, axis=-1) * times > 1)) for times in BRIGHTER)
    return next((times for times, share in white if share <= TOO_BRIGHT), 1)


def _master(case: Callable[[], Case]) -> tuple[Panel, int]:
    return _panel(case(), case().desired, "master"), _brighter(case())


def _pictures(
    place: Place, one: Input, master: Panel, brighter: int, cells: Mapping[str, Cell]
) -> Pictures:
    rows = [cells[name].panels for name in SHOWN]
    heat = [panels[1] for panels in rows if len(panels) > 1]
    what = (
        f"what the left eye sees where the master is dark (below {DARK:.0%}) and subtraction "
        f"leaves most"
        if one.scene is stereo_at
        else "what is seen of the whole domemaster"
    )
    caption = (
        f"{_words(place)}: {what}. Shown {brighter} times brighter than it is: exaggerated, so "
        f"that ghosts can be judged on a display."
    )
    if heat:
        caption += (
            f" Below, what ColorVideoVDP finds lost at each place, from 0 (black) to {LOST:g} JOD "
            f"(light yellow)."
        )
    return Pictures(caption=caption, panels=(master, *(panels[0] for panels in rows), *heat))


# Statistics.


@final
@dataclass(frozen=True)
class Estimate:
    """A mean over inputs, and its 95 % interval; NaN if there are too few inputs."""

    mean: float
    low: float
    high: float
    inputs: int

    @property
    def written(self) -> str:
        """In words, JOD."""
        if self.inputs == 0:
            return "nothing (no input)"
        if self.inputs == 1:
            return f"{self.mean:+.3f} (1 input)"
        return f"{self.mean:+.3f} ({self.low:+.3f} to {self.high:+.3f}, {self.inputs} inputs)"


def estimate(by_input: Iterable[float]) -> Estimate:
    """Student's interval of the mean of independent figures."""
    values = np.array(list(by_input))
    count = len(values)
    if count == 0:
        return Estimate(np.nan, np.nan, np.nan, 0)
    mean = float(values.mean())
    if count == 1:
        return Estimate(mean, np.nan, np.nan, 1)
    half = float(stats.t.ppf(0.975, count - 1) * values.std(ddof=1) / np.sqrt(count))
    return Estimate(mean, mean - half, mean + half, count)


def gains(cells: Cells, way: str, other: str = "subtractive") -> dict[str, float]:
    """Mean gain over another way, JOD, by input: where subtraction leaves what is seen."""
    found: dict[str, list[float]] = {}
    for (name, _, _), ways in cells.items():
        if way in ways and _quality(ways["subtractive"]) < VISIBLE:
            found.setdefault(name, []).append(_quality(ways[way]) - _quality(ways[other]))
    return {name: float(np.mean(values)) for name, values in found.items()}


def shortfalls(cells: Cells, way: str) -> dict[Place, float]:
    """JOD below the better of subtraction and nothing, by place: negative if it is above."""
    return {
        place: max(_quality(ways[name]) for name in ("none", "subtractive")) - _quality(ways[way])
        for place, ways in cells.items()
        if way in ways
    }


def falls(
    cells: Cells, way: str, of: Callable[[Cell], float | None] = lambda cell: cell.contour
) -> dict[Place, float]:
    """How many times less ghost contour than with subtraction, by place."""
    found = {}
    for place, ways in cells.items():
        if way in ways:
            ours, plain = of(ways[way]), of(ways["subtractive"])
            if ours is not None and plain is not None and plain > 0:
                found[place] = plain / max(ours, 1e-9)
    return found


def news(cells: Cells, way: str) -> dict[Place, float]:
    """Share of the screen that is a new artefact, by place."""
    found = {place: ways[way].new for place, ways in cells.items() if way in ways}
    return {place: new for place, new in found.items() if new is not None}


def geometric(by_place: Mapping[Place, float]) -> float:
    """Geometric mean over inputs of those over their places; NaN without any."""
    by_input: dict[str, list[float]] = {}
    for (name, _, _), value in by_place.items():
        by_input.setdefault(name, []).append(np.log(value))
    if not by_input:
        return np.nan
    return float(np.exp(np.mean([np.mean(values) for values in by_input.values()])))


def _quality(cell: Cell) -> float:
    return np.nan if cell.quality is None else cell.quality


# What is said of it.


def _laws(cells: Cells) -> Iterator[Check]:
    """What holds whatever judges say."""
    places = list(cells.values())
    contours = [ways["none"].contour for ways in places]
    yield at_most(
        "nothing done: difference of its ghost contour to 1, the largest",
        max(abs(contour - 1) for contour in contours if contour is not None),
        1e-9,
    )
    yield at_most(
        f"{WAYS[CHOSEN].title}: visible error over subtraction's, mean",
        float(
            np.mean(
                [
                    ways[CHOSEN].error / ways["subtractive"].error
                    for ways in places
                    if ways["subtractive"].error > 0
                ]
            )
        ),
        0.9,
    )
    yield at_most(
        f"{WAYS[CHOSEN].title}: visible error over the least of all other methods, the largest",
        max(_over_the_least(ways) for ways in places),
        1.001,
    )
    yield at_most(
        f"{WAYS[CHOSEN].title}: certified gap where it is visible, the largest",
        max(
            (
                np.inf if ours.gap is None else ours.gap
                for ours in (ways[CHOSEN] for ways in places)
                if ours.status not in (Status.INVISIBLE.name, Status.EXACT.name)
            ),
            default=0.0,
        ),
        1e-3,
    )


def _over_the_least(ways: Mapping[str, Cell]) -> float:
    least = min(cell.error for name, cell in ways.items() if name != CHOSEN)
    return ways[CHOSEN].error / least if least > 0 else float(ways[CHOSEN].error > 0)


def _expectations(cells: Cells, wanted: Mapping[str, Input]) -> Iterator[Check]:
    """What issue 7 asks for, of the judges."""
    title = WAYS[CHOSEN].title
    found = estimate(gains(cells, CHOSEN).values())
    seen = f"over subtraction where that is seen (JOD < {VISIBLE:g}), mean over inputs"
    yield at_least(f"{title}: gain {seen}", found.mean, 0.1, "JOD")
    yield at_least(f"{title}: gain {seen}, lower end of its 95 % interval", found.low, 0, "JOD")
    worst = shortfalls(cells, CHOSEN)
    place = max(worst, key=worst.__getitem__)
    yield at_most(
        f"{title}: largest shortfall against the better of subtraction and nothing "
        f"({_words(place)})",
        worst[place],
        SHORT,
        "JOD",
    )
    contours = falls(cells, CHOSEN)
    if contours:
        yield at_least(
            f"{title}: subtraction's ghost contour over its own where subtraction clips, "
            f"geometric mean over pairs",
            geometric(contours),
            2,
        )
    new = news(cells, CHOSEN)
    place = max(new, key=new.__getitem__)
    yield at_most(
        f"{title}: share of the screen with a new artefact ({NEW:g} JOD worse than subtraction "
        f"and nothing), the largest ({_words(place)})",
        new[place],
        MOST_NEW,
    )


def _result(cells: Cells, wanted: Mapping[str, Input], *, judged: bool) -> str:
    contours = falls(cells, CHOSEN)
    rises = {place: 1 / times for place, times in contours.items()}
    text = (
        f"{len(cells)} cases (an input at a pollution and a luminance) of {len(wanted)} inputs. "
        f"The ghost contour falls {geometric(contours):.2f} times against subtraction (geometric "
        f"mean over pairs; {min(contours.values()):.2f} to {max(contours.values()):.2f}), of "
        f"contrast {geometric(falls(cells, CHOSEN, _of_contrast)):.2f} times. Of light it is more "
        f"than subtraction's in {_beyond(rises, 1, '.2f')}."
    )
    if not judged:
        return text
    title = WAYS[CHOSEN].title
    found = estimate(gains(cells, CHOSEN).values())
    over_none, over_paper = (
        estimate(gains(cells, CHOSEN, other).values()) for other in ("none", "uniform 0.1")
    )
    text = (
        f"{text}\n\nWhere subtraction leaves what is seen, {title} gains {found.written} JOD over "
        f"subtraction, {over_none.written} over nothing and {over_paper.written} over the paper's "
        f"weighting."
    )
    for kind, names in _kinds(wanted).items():
        part = {place: ways for place, ways in cells.items() if place[0] in names}
        text += f" Of {kind}: {estimate(gains(part, CHOSEN).values()).written} over subtraction."
    text += _by_flip(cells)
    for what, values, bound, digits in (
        (
            f"it falls more than {SHORT:g} JOD short of the better of subtraction and nothing",
            shortfalls(cells, CHOSEN),
            SHORT,
            ".3f",
        ),
        (
            f"new artefacts cover more than {MOST_NEW:.0%} of the screen",
            news(cells, CHOSEN),
            MOST_NEW,
            ".1%",
        ),
    ):
        text += f"\n\nIn {_beyond(values, bound, digits)} {what}."
    return text


def _by_flip(cells: Cells) -> str:
    """What FLIP says."""
    found = [
        (ours.flip, plain.flip)
        for ours, plain in ((ways[CHOSEN], ways["subtractive"]) for ways in cells.values())
        if ours.flip is not None and plain.flip is not None
    ]
    if not found:
        return ""
    mine, other = np.mean(found, axis=0)
    better = sum(ours < plain for ours, plain in found)
    return (
        f"\n\nFLIP, which thinks of a desktop display, is {mine:.4f} on average ({other:.4f} with "
        f"subtraction), and less than with subtraction in {better} of {len(found)} cases."
    )


def _beyond(values: Mapping[Place, float], bound: float, digits: str) -> str:
    """In how many cases a figure is beyond its bound, and of which inputs."""
    beyond: dict[str, list[float]] = {}
    for (name, _, _), value in values.items():
        if value > bound:
            beyond.setdefault(name, []).append(value)
    text = f"{sum(map(len, beyond.values()))} of {len(values)} cases"
    if beyond:
        inputs = (
            f"{name} in {len(some)} of {sum(place[0] == name for place in values)}, up to "
            f"{format(max(some), digits)}"
            for name, some in beyond.items()
        )
        text += f" ({'; '.join(inputs)})"
    return text


def _of_contrast(cell: Cell) -> float | None:
    return cell.contrast_contour


def _kinds(wanted: Mapping[str, Input]) -> dict[str, list[str]]:
    """Names of pairs and of domemasters."""
    kinds: dict[str, list[str]] = {"pairs": [], "domemasters": []}
    for name, one in wanted.items():
        kinds["pairs" if one.scene is stereo_at else "domemasters"].append(name)
    return {kind: names for kind, names in kinds.items() if names}


def _tables(cells: Cells, wanted: Mapping[str, Input], *, judged: bool) -> Iterator[Table]:
    if judged:
        yield _by_input(cells, wanted)
    yield _ranking(
        cells,
        MAIN,
        "Methods, over all inputs, pollutions and luminances. Gains are over subtraction where "
        "that is seen, with Student's 95 % interval over inputs; shortfalls are against the better "
        "of subtraction and nothing, over all cases.",
    )
    usual = ContrastWeighting()
    yield _ranking(
        {place: ways for place, ways in cells.items() if place[2] == USUAL_LUMINANCE},
        WAYS,
        f"What each setting of the weighting of local contrast is worth, at "
        f"{USUAL_LUMINANCE:g} cd/m² and all pollutions. Usual: low-frequency gain "
        f"{usual.low_frequency.gain:g}, chromatic {usual.chroma_low_frequency.gain:g}, floor "
        f"{usual.floor:g} cd/m², reach {usual.reach:g}°, most {usual.most:g}.",
    )
    yield _by_place(cells)


def _by_input(cells: Cells, wanted: Mapping[str, Input]) -> Table:
    rows: list[tuple[Entry, ...]] = [
        (
            name,
            *(
                float(
                    np.mean([_quality(ways[way]) for (n, _, _), ways in cells.items() if n == name])
                )
                for way in MAIN
            ),
        )
        for name in wanted
    ]
    return Table(
        caption="ColorVideoVDP by input: means over its pollutions and luminances.",
        columns=(
            Column(name="input"),
            *(Column(name=way.title, unit="JOD", digits=".3f") for way in MAIN.values()),
        ),
        rows=tuple(rows),
    )


def _ranking(cells: Cells, ways: Mapping[str, Way], caption: str) -> Table:
    rows: list[tuple[Entry, ...]] = []
    for name, way in ways.items():
        found = estimate(gains(cells, name).values())
        short = {k: v for k, v in shortfalls(cells, name).items() if np.isfinite(v)}
        worst = max(short, key=short.__getitem__) if short else None
        flips = [
            (here[name].flip or 0.0) - (here["subtractive"].flip or 0.0)
            for here in cells.values()
            if name in here and here[name].flip is not None
        ]
        rows.append(
            (
                way.title,
                found.mean,
                found.low,
                found.high,
                None if worst is None else short[worst],
                "" if worst is None else _words(worst),
                sum(value > SHORT for value in short.values()),
                float(np.mean(flips)) if flips else None,
                geometric(falls(cells, name)),
                geometric(falls(cells, name, _of_contrast)),
                max(news(cells, name).values(), default=None),
                float(np.mean([here[name].seconds for here in cells.values()])),
            )
        )
    return Table(
        caption=caption,
        columns=(
            Column(name="method"),
            Column(name="gain", unit="JOD", digits="+.3f"),
            Column(name="from", unit="JOD", digits="+.3f"),
            Column(name="to", unit="JOD", digits="+.3f"),
            Column(name="worst shortfall", unit="JOD", digits="+.3f"),
            Column(name="where"),
            Column(name=f"cases short by {SHORT:g}"),
            Column(name="FLIP over subtraction's", digits="+.4f"),
            Column(name="ghost contour falls", unit="times", digits=".2f"),
            Column(name="of contrast", unit="times", digits=".2f"),
            Column(name="new artefacts, most", unit="of the screen", digits=".1%"),
            Column(name="time", unit="s", digits=".2f"),
        ),
        rows=tuple(rows),
    )


def _by_place(cells: Cells) -> Table:
    rows: list[tuple[Entry, ...]] = []
    for place, ways in cells.items():
        name, pollution, white = place
        ours, plain = ways[CHOSEN], ways["subtractive"]
        qualities = (ways[way].quality for way in MAIN)
        rows.append(
            (
                name,
                pollution,
                white,
                ours.clipped,
                *qualities,
                ours.new,
                plain.contour,
                ours.contour,
            )
        )
    return Table(
        caption=(
            "All cases: ColorVideoVDP of each method, JOD, and ghost contours where subtraction "
            "clips. Pollution is crosstalk or albedo."
        ),
        columns=(
            Column(name="input"),
            Column(name="pollution", digits="g"),
            Column(name="white", unit="cd/m²", digits="g"),
            Column(name="clipped", digits=".0%"),
            *(Column(name=way.title, digits=".3f") for way in MAIN.values()),
            Column(name="new artefacts", unit="of the screen", digits=".1%"),
            Column(name="contour, subtraction", digits=".3f"),
            Column(name=f"contour, {WAYS[CHOSEN].title}", digits=".3f"),
        ),
        rows=tuple(rows),
    )


def _plots(cells: Cells, wanted: Mapping[str, Input]) -> Iterator[Plot]:
    names = [name for name in wanted if name in gains(cells, CHOSEN)]

    def draw(axes: Any) -> None:
        for offset, way in enumerate(("uniform 0.1", "uniform 0.3", CHOSEN)):
            by_input = gains(cells, way)
            found = estimate(by_input.values())
            heights = [row + 0.2 * (offset - 1) for row in range(len(names) + 1)]
            colour = drawing.COLOURS[offset]
            axes.plot(
                [by_input[name] for name in names],
                heights[:-1],
                marker="o",
                linestyle="",
                color=colour,
                label=WAYS[way].title,
            )
            axes.plot([found.low, found.high], [heights[-1]] * 2, color=colour, linewidth=2.5)
            axes.plot([found.mean], heights[-1:], marker="D", color=colour)
        axes.axvline(0, color="#666666", linewidth=0.8)
        axes.set_yticks(range(len(names) + 1), [*names, "mean, 95 %"])
        axes.invert_yaxis()
        axes.set_xlabel("gain over subtraction, JOD")
        axes.legend(fontsize=7.5, loc="center left", bbox_to_anchor=(1.0, 0.5))

    yield drawing.plot(
        f"Gain over subtraction where that is seen (JOD < {VISIBLE:g}), by input, and its mean "
        f"with Student's 95 % interval over inputs.",
        "Gain in JOD of three perceptual methods over subtraction for every input.",
        draw,
        size=(7.0, 3.8),
    )
    for kind, of_kind in _kinds(wanted).items():
        yield _against_pollution(cells, kind, of_kind)


def _against_pollution(cells: Cells, kind: str, names: Sequence[str]) -> Plot:
    pollutions = sorted({pollution for name, pollution, _ in cells if name in names})
    what = "crosstalk" if kind == "pairs" else "albedo"

    def draw(axes: Any) -> None:
        for way, one in MAIN.items():
            means = [
                np.mean(
                    [
                        _quality(ways[way])
                        for (name, there, _), ways in cells.items()
                        if name in names and there == pollution
                    ]
                )
                for pollution in pollutions
            ]
            axes.plot(
                pollutions,
                means,
                marker="o",
                linewidth=2.5 if way == CHOSEN else 1.2,
                color="#999999" if way == "none" else None,
                label=one.title,
            )
        axes.set_xlabel(what)
        axes.set_ylabel("ColorVideoVDP, JOD")
        axes.legend(fontsize=7.5, loc="center left", bbox_to_anchor=(1.0, 0.5))

    return drawing.plot(
        f"Quality against {what}: means of {len(names)} {kind} over all luminances.",
        f"JOD of each method over {what}, for {kind}.",
        draw,
        size=(7.0, 3.5),
    )


def _figures(cells: Cells) -> dict[str, float | None]:
    found: dict[str, float | None] = {}
    for place, ways in cells.items():
        name, pollution, white = place
        for way, cell in ways.items():
            start = f"quality.{name}.{pollution:g}.{white:g}.{way}"
            found |= {
                f"{start}.quality": cell.quality,
                f"{start}.flip": cell.flip,
                f"{start}.contour": cell.contour,
                f"{start}.new": cell.new,
            }
    for way in MAIN:
        overall = estimate(gains(cells, way).values())
        found |= {
            f"quality.gain.{way}": overall.mean,
            f"quality.gain.{way}.low": overall.low,
            f"quality.gain.{way}.high": overall.high,
        }
    return found


def _words(place: Place) -> str:
    """A place's name."""
    name, pollution, white = place
    return f"{name} at {pollution:g}, {white:g} cd/m²"
