"""One master under all methods: what each would have the audience see, as files and as a page."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from importlib import metadata
from pathlib import Path
from typing import Any, final

import numpy as np

from compensate.figures import Appraisal, Figures
from compensate.master import Outcome, solve_frame
from compensate.methods import Solver, methods_of
from compensate.overlay import Overlay
from compensate.page.page import Figure, View, write_page
from compensate.plain import PlainFigures
from compensate.pose import Eye, Posed, Stage
from compensate.ruler import NO_DIFFERENCE, PEOPLE_SAY
from compensate.unmeasured import Unmeasured, unmeasured
from domesim.frames import Master
from domesim.host.numbers import decimal, percent
from domesim.inspection.magnitudes import SOURCES, Faintest
from domesim.light import Light
from domesim.scene import DomeScene, Scene
from domesim.scene.screening import encoded

DOME = {
    "none": ("Seen, untouched", "the master projected as it is: reflected light greys the blacks"),
    "subtractive": ("Seen, subtractive", "reflected light subtracted, clipped at black"),
    "raised-black": ("Seen, raised black", "the whole picture lifted until nothing clips"),
    "perceptual": (
        "Seen, perceptual",
        "reflected light subtracted, dark places lifted so that contrast is left",
    ),
}
STEREO = {
    "none": ("Seen, untouched", "the master projected as it is: each eye sees a ghost"),
    "subtractive": ("Seen, subtractive", "the ghost subtracted, clipped at black"),
    "raised-black-local": ("Seen, raised black", "lifted around ghosts until nothing clips"),
    "perceptual": ("Seen, perceptual", "the ghost subtracted, the edges of what is left hidden"),
}
"""Methods that are shown: name -> title and note."""
PLAIN = {
    "black": (
        "Black",
        "of the untouched",
        ".0%",
        "Luminance of the darker half of the screen, over the same as it is seen untouched.",
    ),
    "contrast_fine": (
        "Contrast, 0.25 to 1°",
        "of the master",
        ".0%",
        "Luminance against that around it, in the darker four fifths, as far as it is above the "
        "eye's threshold: what is seen of the master's.",
    ),
    "contrast_coarse": (
        "Contrast, 2 to 10°",
        "of the master",
        ".0%",
        "The same of large and faint things, such as the Milky Way, without a threshold.",
    ),
    "stars": (
        "Stars",
        "of the master",
        ".0%",
        "Light of stars over the master's; the median.",
    ),
    "stars_in_order": (
        "Stars in order",
        "of pairs",
        ".0%",
        "Pairs of stars, one of which is 1.25 times as bright, that are seen so.",
    ),
    "hue_shift": ("Hue shift", "°", ".0f", "Mean change of hue in the darker half."),
}
"""Plain figures: name in `Figures` -> title, unit, format, meaning."""


@final
@dataclass(frozen=True)
class Comparison:
    """The outcomes of the methods that are shown, for one master in one scene."""

    frame: Master
    appraisal: Appraisal
    outcomes: Mapping[str, Outcome]
    unmeasured: Unmeasured | None = None

    @property
    def posed(self) -> Posed:
        """The master in its scene."""
        return self.appraisal.posed

    def figures(self) -> dict[str, dict[str, Any]]:
        """Method -> figures."""
        return {method: asdict(outcome.figures) for method, outcome in self.outcomes.items()}

    def albedo(self) -> dict[str, str]:
        """Says what it costs that nobody measured the albedo: heading -> text, or nothing."""
        found = self.unmeasured
        return {} if found is None else {"Albedo not measured": found.told("this picture")}

    def frames(self) -> Iterator[tuple[str, Master]]:
        """Name and frame of what to project, and of what is seen with each method."""
        posed = self.appraisal.posed
        yield "project", self.outcomes["perceptual"].frame
        for method, seen in self._seen():
            yield f"seen-{method}", encoded(self.frame, seen, posed.scene, posed.screen)[0]

    def write_page(self, path: Path, *, size: int, command: str) -> None:
        """Write the compare page.

        Raises
        ------
        InputError
            If it cannot be written.
        """
        scene = self.posed.scene
        titles = shown_methods(scene)
        views = [self._view("Master", self._wanted, "what the audience should see", "master")]
        for method, seen in self._seen():
            view = self._view(titles[method][0], seen, titles[method][1], "seen")
            views.append(replace(view, lost=self.appraisal.lost_map(seen)[self._shown]))
        views.append(
            self._view(
                "Projected, perceptual",
                self.outcomes["perceptual"].light,
                "what the projectors are sent",
                "projected",
            )
        )
        theatre = scene.theatre if isinstance(scene, DomeScene) else None
        write_page(
            path,
            views,
            title=" and ".join(file.name for file in self.frame.paths),
            subtitle=f"{scene.name}: {scene.description}",
            white=scene.projector.white,
            figures=self._table(),
            facts=self._facts(command),
            size=size,
            mask=None if theatre is None else self.posed.screen,
            theatre=theatre,
        )

    @property
    def _wanted(self) -> Light:
        return self.posed.problem.desired[: self.posed.scene.views, ...]

    @property
    def _shown(self) -> slice:
        """The views that the page shows: of many the two in the middle."""
        first = max(0, self.posed.scene.views // 2 - 1)
        return slice(first, first + 2)

    def _view(self, name: str, light: Light, note: str, kind: str) -> View:
        shown = self.posed.scene.projector.to_display(light[self._shown])
        pictures = [np.maximum(eye, 0) for eye in shown]
        return View(name, pictures[0], note, kind, *pictures[1:])

    def _seen(self) -> Iterator[tuple[str, Light]]:
        for method, outcome in self.outcomes.items():
            yield method, self.posed.seen(outcome.light)

    def _table(self) -> list[Figure]:
        screen, projector = self.posed.screen, self.posed.scene.projector
        titles = shown_methods(self.posed.scene)
        names = {method: titles[method][0] for method in self.outcomes}
        pictures = {"Master": self._wanted}
        pictures |= {names[method]: seen for method, seen in self._seen()}
        darkest = {
            name: float(np.percentile(projector.luminance(seen)[:, screen], 1))
            for name, seen in pictures.items()
        }
        table = [
            Figure(
                "Quality lost",
                "JOD",
                {names[m]: f"{o.figures.loss_after:.2f}" for m, o in self.outcomes.items()},
                f"How much worse it looks than the master, by ColorVideoVDP. {PEOPLE_SAY} Below "
                f"{NO_DIFFERENCE:g} JOD there is no difference. It cannot see how grey black is, "
                "nor the figures below.",
            ),
            *self._plain(names),
            *self._sky(names),
            Figure(
                "Darkest 1 %",
                "cd/m²",
                {name: decimal(value) for name, value in darkest.items()},
                "Luminance below which the darkest hundredth of the screen lies.",
            ),
        ]
        if self.appraisal.of_ghosts:
            table += self._ghosts(names)
        by_seat = [
            Figure(
                f"Quality lost, {seat}",
                "JOD",
                {names[m]: f"{o.figures.loss_by_seat[seat]:.2f}" for m, o in self.outcomes.items()},
                "The same at this seat; the pictures are what the first seat sees.",
            )
            for seat in next(iter(self.outcomes.values())).figures.loss_by_seat
        ]
        return table + by_seat

    def _plain(self, names: Mapping[str, str]) -> Iterator[Figure]:
        """Figures of `compensate.plain` that some method has."""
        for key, (title, unit, form, meaning) in PLAIN.items():
            values = {names[m]: getattr(o.figures, key) for m, o in self.outcomes.items()}
            texts = {
                name: format(value, form) for name, value in values.items() if value is not None
            }
            if texts:
                yield Figure(title, unit, texts, meaning)

    def _sky(self, names: Mapping[str, str]) -> Iterator[Figure]:
        """A dome's sky in magnitudes, of the master, too."""
        figures: dict[str, PlainFigures | Figures] = {"Master": self.appraisal.of_master}
        figures |= {names[method]: outcome.figures for method, outcome in self.outcomes.items()}
        skies = {name: f"{f.sky:.1f}" for name, f in figures.items() if f.sky is not None}
        faintest = {name: each.told for name, f in figures.items() if (each := faintest_of(f))}
        if skies:
            yield Figure(
                "Sky",
                "mag/arcsec²",
                skies,
                "Surface brightness of the darker half of the screen. More is darker.",
            )
        if faintest:
            yield Figure(
                "Faintest star",
                "magnitude",
                faintest,
                f"Of the master's stars, over the darker half, by two authors' thresholds: "
                f"{SOURCES}.",
            )

        if found := [p for f in figures.values() if (p := projected_of(f))]:
            names_of = dict(zip(figures, found, strict=True))
            yield Figure(
                "Star projector's faintest star",
                "magnitude",
                {name: each.told for name, each in names_of.items()},
                "Of the star projector beside the video, over the darker half of that: its stars "
                "keep their light.",
            )

    def stars(self) -> str | None:
        """Says what happens to the faintest star, in a line; None without a sky."""
        master = faintest_of(self.appraisal.of_master)
        if master is None:
            return None
        parts = [f"master {master.told}"]
        for method, outcome in self.outcomes.items():
            if found := faintest_of(outcome.figures):
                factor = decimal(10 ** (0.4 * (master.crumey - found.crumey)), 2)
                parts.append(f"{method} {found.told}, where it has {factor} times the light")
        return f"Faintest star, magnitudes ({SOURCES}): {'; '.join(parts)}"

    def _ghosts(self, names: Mapping[str, str]) -> list[Figure]:
        """What is left of the ghosts, as `compensate.ghosts` and the documents define it."""
        contours: dict[str, str] = {}
        for method, outcome in self.outcomes.items():
            contour = self.appraisal.ghost_contour(outcome.light)
            if contour is not None:
                contours[names[method]] = f"{contour:.0%}"
        edges = {
            names[m]: f"{o.figures.ghost_edges:.0%}"
            for m, o in self.outcomes.items()
            if o.figures.ghost_edges is not None
        }
        return [
            Figure(
                "Ghost contour",
                "of the untouched",
                contours,
                "Edges of ghosts that are left where subtraction clips, which is where methods "
                "differ.",
            ),
            Figure(
                "Ghost edge energy",
                "of the untouched",
                edges,
                "All edges over the whole picture that are not the master's, those of veils too.",
            ),
        ]

    def _facts(self, command: str) -> dict[str, str]:
        scene, best = self.posed.scene, self.outcomes["perceptual"].figures
        polluted = f"{scene.pollution.capitalize()} and stray light"
        return {
            "Master": self.frame.described(),
            **scene.facts(),
            **self._told_of_views(),
            **self.albedo(),
            polluted: f"{decimal(best.pollution)} cd/m² on average, untouched",
            "Too dark for exact subtraction": f"{best.clipped:.1%} of the screen",
            "Out of the projector's range": f"{best.out_of_range:.1%} of the screen",
            "Method": f"{best.status} {best.seconds:.1f} s"
            if best.gap is None
            else f"{best.status} {best.iterations} iterations, {best.ffts} FFTs, "
            f"{best.seconds:.1f} s, within {percent(best.gap)} of the optimum",
            "Version": f"domesim {metadata.version('domesim')}",
            "Command": command,
        }

    def _told_of_views(self) -> dict[str, str]:
        """Which of many views the page shows."""
        shown, views = self._shown, self.posed.scene.views
        if views <= 2:
            return {}
        return {"Pictures": f"views {shown.start + 1} and {shown.stop} of {views}, for two eyes"}


def faintest_of(figures: PlainFigures | Figures) -> Faintest | None:
    """The faintest star by both authors."""
    if figures.faintest_star is None or figures.faintest_star_schaefer is None:
        return None
    return Faintest(figures.faintest_star_schaefer, figures.faintest_star)


def projected_of(figures: PlainFigures | Figures) -> Faintest | None:
    """The faintest star of a star projector, by both authors."""
    if figures.projected_star is None or figures.projected_star_schaefer is None:
        return None
    return Faintest(figures.projected_star_schaefer, figures.projected_star)


def shown_methods(scene: Scene) -> Mapping[str, tuple[str, str]]:
    """The methods that a comparison shows: name -> title and note."""
    return STEREO if "raised-black-local" in methods_of(scene) else DOME


def compare_methods(
    frame: Master,
    scene: Scene,
    *,
    solver: Solver | None,
    weighting: Eye | None,
    overlay: Overlay | None = None,
    progress: Callable[[str], None] = lambda name: None,
) -> Comparison:
    """Run the methods that are shown on one master; `solver` is the perceptual one's.

    An `overlay` is seen in all pictures: what the server shows.

    Raises
    ------
    InputError
        If the frame is no master for the scene.
    """
    posed, out_of_range = Stage(scene, weighting).pose_frame(frame, overlay)
    appraisal = Appraisal(posed)
    outcomes = {}
    for method in shown_methods(scene):
        progress(method)
        outcomes[method] = solve_frame(
            frame, posed, out_of_range, method, solver if method == "perceptual" else None
        ).outcome(appraisal)
    shown = outcomes["perceptual"].light
    return Comparison(frame, appraisal, outcomes, unmeasured(posed, shown, appraisal))
