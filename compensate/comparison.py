"""One master under all methods: what each would have the audience see, as files and as a page."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, final

import numpy as np

from compensate.master import Outcome, Posed, Solver, pose_frame, solve_frame
from compensate.page import Figure, View, write_page
from compensate.weighting import PerceptualWeighting
from domesim.frames import Frame
from domesim.light import Light
from domesim.scene import Scene
from domesim.screening import encoded

SEEN = {
    "none": ("Seen, untouched", "the master projected as it is: reflected light greys the blacks"),
    "subtractive": ("Seen, subtractive", "reflected light subtracted, clipped at black"),
    "raised-black": ("Seen, raised black", "the whole picture lifted until nothing clips"),
    "perceptual": ("Seen, perceptual", "the least visible error within the projector's range"),
}


@final
@dataclass(frozen=True)
class Comparison:
    """The outcomes of all methods for one frame in one theatre."""

    frame: Frame
    posed: Posed
    outcomes: Mapping[str, Outcome]

    def figures(self) -> dict[str, dict[str, Any]]:
        """Method -> figures."""
        return {method: asdict(outcome.figures) for method, outcome in self.outcomes.items()}

    def frames(self) -> Iterator[tuple[str, Frame]]:
        """Name and frame of what to project, and of what is seen with each method."""
        posed = self.posed
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
        scene, wanted = self.posed.scene, self.posed.problem.desired
        views = [View("Master", self._shown(wanted), "what the audience should see", "master")]
        for method, seen in self._seen():
            views.append(View(SEEN[method][0], self._shown(seen), SEEN[method][1], "seen"))
        views.append(
            View(
                "Projected, perceptual",
                self._shown(self.outcomes["perceptual"].light),
                "the frame that the projectors are sent",
                "projected",
            )
        )
        write_page(
            path,
            views,
            title=self.frame.path.name,
            subtitle=f"{scene.name}: {scene.description}",
            white=scene.projector.white,
            figures=self._table(),
            facts=self._facts(command),
            size=size,
            mask=self.posed.screen,
            half_angle_deg=float(np.degrees(scene.dome.half_angle)),
        )

    def _seen(self) -> Iterator[tuple[str, Light]]:
        for method, outcome in self.outcomes.items():
            yield method, self.posed.problem.observation.observe(outcome.light)

    def _shown(self, light: Light) -> Any:
        return np.maximum(self.posed.scene.projector.to_display(light), 0)

    def _table(self) -> list[Figure]:
        screen, projector = self.posed.screen, self.posed.scene.projector
        weights = projector.luminance_weights * projector.white
        names = {method: SEEN[method][0] for method in self.outcomes}
        pictures = {"Master": self.posed.problem.desired}
        pictures |= {names[method]: seen for method, seen in self._seen()}
        darkest = {
            name: float(np.percentile(seen[0][screen] @ weights, 1))
            for name, seen in pictures.items()
        }
        return [
            Figure(
                "Visible error",
                "JND rms",
                {names[m]: f"{o.figures.error_after:.3g}" for m, o in self.outcomes.items()},
                "Difference from the master, weighted by contrast sensitivity, in just-noticeable "
                "differences.",
            ),
            Figure(
                "Darkest 1 %",
                "cd/m²",
                {name: f"{value:.3g}" for name, value in darkest.items()},
                "Luminance below which the darkest hundredth of the screen lies.",
            ),
        ]

    def _facts(self, command: str) -> dict[str, str]:
        scene, best = self.posed.scene, self.outcomes["perceptual"].figures
        return {
            "Master": self.frame.described(),
            "Theatre": f"{scene.name}, radius {scene.dome.radius:g} m, half-angle "
            f"{np.degrees(scene.dome.half_angle):g}°, albedo "
            f"{', '.join(f'{a:.3g}' for a in scene.albedo)} (holes counted in)",
            "Projector": f"white {scene.projector.white:g} cd/m², black "
            f"{scene.projector.black:g} cd/m², {scene.projector.primaries} primaries",
            "Reflected and stray light": f"{best.pollution:.3g} cd/m² on average, untouched",
            "Too dark for exact subtraction": f"{best.clipped:.1%} of the screen",
            "Out of the projector's range": f"{best.out_of_range:.1%} of the screen",
            "Solver": f"{best.status} {best.iterations} iterations, {best.ffts} FFTs, "
            f"{best.seconds:.1f} s"
            + ("" if best.gap is None else f", within {best.gap:.1e} of the optimum"),
            "Model": (
                "closed-form cross-reflection of a Lambertian cap (all bounces), as computed by "
                "the program; not a measurement"
                if scene.transport is None
                else "the whole theatre's light transport as tabulated by path tracing"
            )
            + ("" if scene.approximation is None else f"; {scene.approximation}"),
            "Version": f"domesim {metadata.version('domesim')}",
            "Command": command,
        }


def compare_methods(
    frame: Frame,
    scene: Scene,
    *,
    solver: Solver | None,
    weighting: PerceptualWeighting,
    progress: Callable[[str], None] = lambda name: None,
) -> Comparison:
    """Run all methods on one frame; `solver` is the perceptual one's.

    Raises
    ------
    InputError
        If the frame is no domemaster.
    """
    posed, out_of_range = pose_frame(frame, scene, weighting)
    outcomes = {}
    for method in SEEN:
        progress(method)
        outcomes[method] = solve_frame(
            frame, posed, out_of_range, method, solver if method == "perceptual" else None
        )
    return Comparison(frame, posed, outcomes)
