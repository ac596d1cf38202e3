"""What ``domesim compensate`` does to each frame."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, final

from compensate.aim import Aim
from compensate.devices import CPU, on_device
from compensate.figures import Appraisal, Figures
from compensate.fourier import transforms
from compensate.master import Solution, solve_frame
from compensate.methods import Solver, perceptual, require_method
from compensate.pose import Eye, Posed, Stage
from compensate.ruler import NO_DIFFERENCE, PEOPLE_SAY, agreeing, compared
from compensate.shows.cue_list import CANDIDATES, CueList
from compensate.shows.cues import AUTO
from compensate.shows.eyes import doubt
from compensate.shows.films import films_lost
from compensate.shows.over_time import timeline
from compensate.shows.titles import Titles
from compensate.solve import solved
from compensate.solver.accelerated import Accelerated
from compensate.solver.result import Status
from compensate.steps import COARSE, are_fine, visible_steps
from compensate.visible import OnlyVisible, SpatiallyWeighted
from compensate.vision.csf import LowFrequencyFloor
from compensate.weighting import PerceptualWeighting
from domesim.errors import InputError
from domesim.frames import Master
from domesim.host.numbers import decimal, percent
from domesim.light import Light
from domesim.light.planes import every, planes_of
from domesim.scene import Scene, StereoScene
from domesim.scene.choice import SceneChoice
from domesim.scene.grade import KEPT
from domesim.scene.screening import decoded, decoder, within_range
from domesim.shows.sequences import number_of
from domesim.shows.small import thinning
from domesim.shows.timeline import Panel, Timeline
from domesim.shows.work import Column, Judged, Note, Recipe, Work, Write, Writing

PAPER, CONTRAST = "paper", "contrast"
"""What a picture can be made for: the paper's least squares, or its contrasts (the aim)."""

WORSE = 0.005
"""JOD beyond which a frame is said to be worse than untouched: what two digits of a figure show."""

SIZE = 1024
"""Largest side of pictures on the pages of the worst frames, pixels."""


@final
@dataclass(frozen=True)
class Compensating(Recipe):
    """What to project for each frame, in its own encoding.

    Parameters
    ----------
    scene
        The theatre, or stereo system.
    method
        One of the scene's methods.
    tolerance
        Tolerance of the perceptual method.
    eye
        "contrast" or "paper"; None for the scene's default.
    lift
        How many times the aim lifts the missing light; None for its own.
    low_frequency_gain
        Floor of the paper's weighting; None for its own.
    device
        What computes.
    only_visible
        Solve only where what subtraction leaves is predicted to be seen.
    spatial
        Count errors by how visible the pollution is there (eq. 7).
    titles
        What a server composites over the frames; None for nothing.
    cue_list
        A person's; or of the method "auto", which settings of a job leave out: its masters decide.
        None for none.
    """

    scene: SceneChoice
    method: str = "perceptual"
    tolerance: float = 1e-3
    eye: str | None = None
    lift: float | None = None
    low_frequency_gain: float | None = None
    device: str = CPU
    only_visible: bool = False
    spatial: bool = False
    titles: Titles | None = None
    cue_list: CueList | None = None

    def work(self, note: Note) -> Work[Any, Any]:
        """See `Recipe`."""
        theatre = self.scene.load()
        solver = self.solver(theatre, note)
        stage = Stage(theatre, self.weighting(theatre))

        def prepare(source: Master) -> tuple[Master, Posed, float]:
            return source, *self._posed(stage, source, theatre)

        def solve(given: tuple[Master, Posed, float]) -> Solution:
            source, posed, out_of_range = given
            chosen = OnlyVisible(posed, solver) if self.only_visible and solver else solver
            if self.spatial:
                chosen = SpatiallyWeighted(posed, self._masked(posed))
            return solve_frame(source, posed, out_of_range, self._method(source), chosen)

        return Work(prepare, solve, _end, stage.ready)

    def _posed(self, stage: Stage, source: Master, theatre: Scene) -> tuple[Posed, float]:
        """A master in its scene, as of `Stage.pose_frame`."""
        overlay = None if self.titles is None else self.titles.of(source, theatre)
        posed, out_of_range = stage.pose_frame(source, overlay)
        if self.cue_list is not None:
            posed = replace(posed, lift=self._lift(source.path, theatre))
        return posed, out_of_range

    def _lift(self, path: Path, theatre: Scene) -> float:
        """The lift of a master that a cue list is for."""
        aim = self.weighting(theatre)
        assert self.cue_list is not None
        assert isinstance(aim, Aim)  # see `require_sense`
        return self.cue_list.lift(number_of(path) or 0, aim.lift)

    def _method(self, source: Master) -> str:
        """The method of a master."""
        usual = CANDIDATES[0] if self.method == AUTO else self.method
        if self.cue_list is None:
            return usual
        return self.cue_list.method(number_of(source.path) or 0, usual)

    def require_sense(self, theatre: Scene) -> None:
        """See that the settings go together.

        Raises
        ------
        InputError
            If they do not.
        """
        eye = self.weighting(theatre)
        if self.cue_list is not None and not isinstance(eye, Aim):
            raise InputError(
                f"--cues tells methods and lifts of the aim: leave --weighting {PAPER} out"
            )
        if self.method != AUTO:
            require_method(self.method, theatre)
        elif not isinstance(eye, Aim):
            raise InputError(
                f"--method {AUTO} chooses between the aim, subtraction and none; leave --weighting "
                f"{PAPER} out"
            )
        if not 0 < self.tolerance < 1:
            raise InputError(f"tolerance must lie between 0 and 1, got {self.tolerance:g}")
        if self._aims(theatre) and (self.only_visible or self.device != CPU):
            raise InputError(
                f"--only-visible and --device belong to --weighting {PAPER}: contrasts need no "
                f"solver"
            )
        if self.spatial:
            self._require_spatial(theatre)
        if self.only_visible and not (self.method == "perceptual" and self._plain(theatre)):
            raise InputError(
                "--only-visible is for --method perceptual, one seat without a grey-to-grey "
                "table, and the processor; leave it out"
            )
        if self.method != "perceptual" and self.device != CPU:
            raise InputError(
                f"--device {self.device}: {self.method} is computed on the processor only"
            )

    def _require_spatial(self, theatre: Scene) -> None:
        """See that eq. 7 is asked for where it can be."""
        if not (self._least_squares(theatre) and self._plain(theatre)) or self.only_visible:
            raise InputError(
                f"--spatial-weights is for --weighting {PAPER} or --method paper, one seat without "
                f"a grey-to-grey table, the processor, and not --only-visible; leave it out"
            )

    def _plain(self, theatre: Scene) -> bool:
        """Whether it is of one seat without a grey-to-grey table, on the processor."""
        table = isinstance(theatre, StereoScene) and theatre.table is not None
        return not (theatre.several_seats or table or self.device != CPU)

    def _masked(self, posed: Posed) -> Solver:
        """What solves masked problems."""
        if self.method == "paper":
            return require_method("paper", posed.scene)(posed.scene, posed.single)
        return Accelerated(self.tolerance)

    def _aims(self, theatre: Scene) -> bool:
        """Whether an aim is shown, which takes no solver."""
        return self.method in ("perceptual", AUTO) and isinstance(self.weighting(theatre), Aim)

    def _least_squares(self, theatre: Scene) -> bool:
        """Whether the paper's weighting is minimised."""
        return self.method in ("paper", "perceptual") and not self._aims(theatre)

    def weighting(self, theatre: Scene) -> Eye:
        """What pictures are made for.

        Raises
        ------
        InputError
            If there is no such thing, or a setting belongs to the other.
        """
        if self.eye not in (None, PAPER, CONTRAST):
            raise InputError(
                f"--weighting {self.eye!r} is not known; use one of {CONTRAST}, {PAPER}"
            )
        found: Eye = Aim()
        if self.eye is not None:
            found = Aim() if self.eye == CONTRAST else PerceptualWeighting()
        if self.lift is not None and not isinstance(found, Aim):
            raise InputError(f"--lift belongs to --weighting {CONTRAST}; leave it out")
        if self.low_frequency_gain is not None and isinstance(found, Aim):
            raise InputError(
                f"--low-frequency-gain belongs to --weighting {PAPER}; for {CONTRAST}, use --lift"
            )
        if self.lift is not None:
            return Aim(lift=self.lift)
        if self.low_frequency_gain is not None:
            return PerceptualWeighting(LowFrequencyFloor(self.low_frequency_gain))
        return found

    def solver(self, theatre: Scene, note: Note) -> Solver | None:
        """The solver of the paper's weighting, or None: all else is computed directly.

        Raises
        ------
        InputError
            If the settings do not go together, or there is no such device.
        """
        self.require_sense(theatre)
        if self.method not in ("perceptual", AUTO) or self._aims(theatre):
            return None

        def progress(iteration: int, gap: float) -> None:
            note(f"iteration {iteration}, within {percent(gap)} of the optimum")

        solver = perceptual(theatre, self.tolerance, progress=progress)
        return on_device(solver, self.device)

    def settings(self) -> dict[str, Any]:
        """See `Recipe`."""
        left_out = ("scene", "titles", "cue_list")
        settings = {name: value for name, value in vars(self).items() if name not in left_out}
        settings = {"command": "compensate", **self.scene.settings(), **settings}
        if self.titles is not None:
            settings["overlay"] = self.titles.settings()
        if self.cue_list is not None and self.method != AUTO:
            settings["cues"] = self.cue_list.settings()
        if self._least_squares(self.scene.load()):
            # Solvers round otherwise with it; nothing else uses it
            settings["fast"] = transforms().__name__
        return settings

    @property
    def about(self) -> str:
        """See `Recipe`: what becomes of light without a picture."""
        theatre = self.scene.load()
        return f"{theatre.name}: {theatre.graded}"

    def doubt(self, masters: Iterable[Master]) -> str | None:
        """See `Recipe`: whether left and right belong together."""
        return doubt(masters, self.scene.load())

    small = "The master, and what is projected"

    def options(self, writing: Writing) -> dict[str, str]:
        """See `Recipe`."""
        overlay = {} if self.titles is None else {"--overlay": " and ".join(self.titles.names)}
        asked = self.cue_list is not None and self.method != AUTO
        cues = {"--cues": self.cue_list.name} if self.cue_list is not None and asked else {}
        return self.choices() | overlay | cues | writing.options()

    def choices(self) -> dict[str, str]:
        """Those of `options` that say what is computed."""
        theatre = self.scene.load()
        found = {**self.scene.options(), "--method": self.method}
        if self.method not in ("perceptual", AUTO):
            return found | ({"--spatial-weights": "yes"} if self.spatial else {})
        weighting = self.weighting(theatre)
        if isinstance(weighting, Aim):
            return {**found, "--weighting": CONTRAST, "--lift": f"{weighting.lift:g}"}
        found |= {"--weighting": PAPER, "--tolerance": f"{self.tolerance:g}"}
        gain = self.low_frequency_gain
        found["--low-frequency-gain"] = f"{LowFrequencyFloor().gain if gain is None else gain:g}"
        found["--device"] = self.device
        found |= {"--only-visible": "yes"} if self.only_visible else {}
        return found | ({"--spatial-weights": "yes"} if self.spatial else {})

    def judged(self, figures: Mapping[str, Any]) -> Judged | None:
        """See `Recipe`: by what is lost of the quality, as stored where that is known."""
        after, before = figures["loss_after"], figures["loss_before"]
        plain, stored = figures["loss_subtractive"], figures.get("loss_stored")
        if before is None:
            return Judged("as the master", "nothing is too dark for exact subtraction", 0)
        if stored is not None and _rounding_shows(after, stored):
            told = f"{stored:.2f} JOD as stored, {after:.2f} before rounding"
            return Judged("rounding shows", told, 2)
        lost = f"{after:.2f} JOD lost, {before:.2f} untouched"
        verdict, needs = "better than untouched", 0
        if after < NO_DIFFERENCE:
            verdict, lost = "as the master, to the eye", f"{lost} ({NO_DIFFERENCE:g} is not seen)"
        elif (against := compared(after, before)) != "better than":
            verdict, needs = f"{against} untouched", 2 if against == "worse than" else 1
        elif figures.get("method", self.method) == "perceptual":
            lost = f"{lost}, {plain:.2f} subtracted"
            verdict = f"{compared(after, plain)} subtraction"
            needs = int(verdict.startswith("worse"))
        if abs(after - before) >= NO_DIFFERENCE:
            lost = f"{lost}; of shown and untouched, {agreeing(after, before)}"
        return Judged(verdict, lost, needs)

    def over_time(
        self, frames: Sequence[Mapping[str, Any]], seconds: Sequence[float]
    ) -> Timeline | None:
        """See `Recipe`: black, and stars; and the lift, where a cue list says it."""
        names = {"untouched": "untouched", "seen": "as shown"}
        found = timeline([frame.get("dark") for frame in frames], seconds, names)
        if found is None or self.cue_list is None or not self.cue_list.lifts:
            return found
        theatre, sources = self.scene.load(), [frame["input"] for frame in frames]
        paths = [Path(each if isinstance(each, str) else each[0]) for each in sources]
        lift = Panel("lift", {"as shown": [self._lift(path, theatre) for path in paths]})
        return replace(found, panels=[*found.panels, lift])

    def columns(self) -> tuple[Column, ...]:
        """See `Recipe`."""
        return (
            Column("loss_after", "Quality lost", "JOD"),
            Column("loss_stored", "As stored", "JOD"),
            Column("loss_subtractive", "If subtracted", "JOD"),
            Column("loss_before", "Untouched", "JOD"),
            Column("black", "Black over untouched", "%"),
            Column("contrast_fine", "Contrast, 0.25 to 1°", "%", less=True),
            Column("contrast_coarse", "Contrast, 2 to 10°", "%", less=True),
            Column("stars_in_order", "Stars in order", "%", less=True),
            Column("hue_shift", "Hue shift", "°"),
            Column("clipped", "Too dark", "%"),
            Column("out_of_range", "Out of range", "%"),
        )

    def memory(self, rows: int, cols: int) -> int:
        """See `Recipe`: a quarter more than measured (28 and 50 planes without a solver)."""
        theatre = self.scene.load()
        simple = self._aims(theatre) or self.method in ("none", "subtractive")
        of_one, of_two = (35, 65) if simple and not theatre.several_seats else (75, 160)
        planes = of_one if theatre.views == 1 else of_two
        return 500_000_000 + planes * 4 * rows * cols

    def resources(self) -> dict[str, float]:
        """See `Recipe`: a GPU, if one computes."""
        return {"GPU": 1} if self.device.partition(":")[0] == "cuda" else {}

    def film(self, masters: Iterable[Master], rate: float) -> dict[str, float]:
        """See `Recipe`: as shown before rounding, subtracted, and untouched."""
        theatre = self.scene.load()
        solver = self.solver(theatre, lambda text: None)
        stage = Stage(theatre, self.weighting(theatre))

        def shown(master: Master) -> tuple[Posed, dict[str, Light]]:
            posed, _ = self._posed(stage, master, theatre)
            chosen = SpatiallyWeighted(posed, self._masked(posed)) if self.spatial else solver
            light = solved(posed, self._method(master), chosen).light
            ways = {"as shown": light, "subtracted": posed.subtractive, "untouched": posed.desired}
            return posed, ways

        return films_lost(map(shown, masters), rate)

    film_note = PEOPLE_SAY
    compares = True

    def command(self) -> str:
        """The command line, but for files."""
        options = [part for option in self.choices().items() for part in option if part != "yes"]
        for name in () if self.titles is None else self.titles.names:
            options += ["--overlay", name]
        return shlex.join(["domesim", "compensate", *options])

    def compare(self, master: Master, page: Path) -> None:
        """See `Recipe`: master, and what is seen untouched and compensated."""
        from compensate.page.comparison import compare_methods  # noqa: PLC0415 - slow to import

        theatre = self.scene.load()
        weighting = self.weighting(theatre)
        solver = self.solver(theatre, lambda text: None)
        overlay = None if self.titles is None else self.titles.of(master, theatre)
        comparison = compare_methods(
            master, theatre, solver=solver, weighting=weighting, overlay=overlay
        )
        comparison.write_page(page, size=SIZE, command=self.command())


def _end(solution: Solution, write: Write) -> tuple[dict[str, Any], str]:
    """Write it while its figures are computed; of what subtraction shows, only quick ones."""
    posed, light = solution.posed, solution.result.light
    appraisal, exact = Appraisal(posed), posed.exact and posed.subtracts(light)
    show, step = posed.scene.projector.to_display, thinning(posed.screen.shape)
    views = posed.scene.views
    small = [show(every(each, views, step))[0] for each in (posed.planes, planes_of(light))]
    coarse, weights = 0.0, posed.scene.projector.luminance_weights
    if not exact and not are_fine(solution.frame):
        coarse = visible_steps(solution.frame, posed.seen(light), posed.screen, weights)
    del light
    frame, clipped, glance = solution.spent(appraisal)
    frames = [frame]
    del frame
    with ThreadPoolExecutor(1, "domesim-file") as beside:
        written = beside.submit(lambda: write.__call__(frames.pop()))  # which alone knows it then
        found = solution.figures(appraisal, clipped, brief=exact, glance=glance)
        written.result()
    write.small(*small)
    if exact:
        return {**asdict(found), "loss_stored": None, "steps": 0.0}, line_of(found)
    stored = write.stored()
    bits, suffix = stored.bits, stored.path.suffix
    by_strips = posed.floor is not None
    if posed.scene.grade.gamut == KEPT or posed.overlay is not None:
        light = within_range(decoded(stored, posed.scene), posed.screen)[0]  # what is clipped, too
        lost = appraisal.loss(light if posed.overlay is None else posed.overlay.over(light))
    else:
        lost = appraisal.loss((decoder if by_strips else decoded)(stored, posed.scene))
    del stored
    line = line_of(found)
    if coarse > COARSE:
        line += (
            f"\n  steps between the master's codes are seen on {coarse:.1%} of the screen: render "
            f"it in 16 bits"
        )
    if _rounding_shows(found.loss_after, lost):
        line += (
            f"\n  quality lost as stored: {lost:.2f} JOD. Rounding to {bits} bit {suffix} shows; "
            f"choose another --format or --bits"
        )
    return {**asdict(found), "loss_stored": lost, "steps": coarse}, line


def worse_than_untouched(frames: Sequence[Mapping[str, Any]]) -> str:
    """Says how many frames look worse than untouched, and which most; "" for none.

    Parameters
    ----------
    frames
        Their figures.
    """
    worse = [
        (lost, frame["input"])
        for frame in frames
        if frame["loss_before"] is not None
        and (lost := frame["loss_after"] - frame["loss_before"]) > WORSE
    ]
    if not worse:
        return ""
    most, source = max(worse, key=lambda each: each[0])
    name = Path(source if isinstance(source, str) else source[0]).name
    return (
        f"worse than untouched: {len(worse)} of {len(frames)} frames, {name} by {most:.3f} JOD "
        f"({NO_DIFFERENCE:g} is not seen); --method {AUTO} leaves such shots alone"
    )


def _people(f: Figures) -> str:
    """How often people order it and the untouched as the figures do, if these differ."""
    if f.loss_before is None or abs(f.loss_after - f.loss_before) < NO_DIFFERENCE:
        return ""
    return f"; it and the untouched: {agreeing(f.loss_after, f.loss_before)}"


def _worse(f: Figures) -> str:
    """Whether it is worse than untouched, however little."""
    if f.loss_before is None or f.loss_after - f.loss_before <= WORSE:
        return ""
    return f"; worse than untouched by {f.loss_after - f.loss_before:.3f} JOD"


def _plain(f: Figures) -> list[str]:
    """What ColorVideoVDP cannot see, for a person."""
    lines = {
        "black": {"{:.2f} times the untouched": f.black},
        "contrast kept": {
            "{:.0%} (0.25 to 1°)": f.contrast_fine,
            "{:.0%} (2 to 10°)": f.contrast_coarse,
        },
        "stars": {"{:.2f} times as bright": f.stars, "{:.0%} in order": f.stars_in_order},
        "hue": {"{:.0f}° off": f.hue_shift},
        "sky, magnitudes": {
            "{:.1f} an arcsec²": f.sky,
            "faintest star {:.1f} (Crumey 2014, F = 2)": f.faintest_star,
            "{:.1f} (Schaefer 1990)": f.faintest_star_schaefer,
        },
        "star projector": {
            "faintest star {:.1f} (Crumey 2014, F = 2)": f.projected_star,
            "{:.1f} (Schaefer 1990)": f.projected_star_schaefer,
        },
    }
    told = {
        name: [form.format(value) for form, value in forms.items() if value is not None]
        for name, forms in lines.items()
    }
    return [f"{name}: {', '.join(parts)}" for name, parts in told.items() if parts]


def _rounding_shows(computed: float, stored: float) -> bool:
    return stored > 1.1 * computed and compared(stored, computed) == "worse than"


def line_of(f: Figures) -> str:
    """What was done and how good it is, for a person: below one another, a fact a line."""
    parts = [f"{f.method}, {decimal(f.seconds, 2)} s"]
    if f.loss_before is None:
        parts.append(f"{decimal(f.pollution, 2)} cd/m² of pollution, all of it subtracted")
    else:
        parts += [
            f"quality lost: {f.loss_after:.2f} JOD; untouched {f.loss_before:.2f}, subtracted "
            f"{f.loss_subtractive:.2f}" + _worse(f) + _people(f),
            f"too dark for exact subtraction: {f.clipped:.1%} of the screen",
        ]
    if f.loss_by_seat:
        seats = ", ".join(f"{name} {lost:.2f}" for name, lost in f.loss_by_seat.items())
        parts.append(f"quality lost by seat, JOD: {seats}")
    parts += _plain(f)
    if f.out_of_range:
        parts.append(f"out of the projector's range: {percent(f.out_of_range)} of the screen")
    if f.file_clipped:
        parts.append(f"out of the file's colour range, and clipped: {percent(f.file_clipped)}")
    if f.gap is not None and f.iterations:
        parts.append(f"within {percent(f.gap)} of the optimum after {f.iterations} iterations")
        if f.distance:
            parts.append(
                f"what is seen is within {decimal(f.distance, 2)} JND (rms) of the optimum's"
            )
    if f.status not in _USUAL:
        parts.append(f.status)
    if f.light_left is not None and f.error_left is not None:
        low, likely, high = (percent(light, 3) for light in f.light_left)
        least, error, most = (decimal(error) for error in f.error_left)
        parts += [
            f"light left over: {likely} of white (95%, as surely as the room was measured: "
            f"{low} to {high})",
            f"visible error: {error} (95%: {least} to {most})",
        ]
    return "\n  ".join(parts)


_USUAL = {Status.AIMED.value, Status.CLOSED_FORM.value, Status.CONVERGED.value}
