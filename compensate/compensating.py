"""What ``domesim compensate`` does to each frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, final

from compensate.comparison import compare_methods
from compensate.contrast import ContrastWeighting, Eye
from compensate.devices import CPU, on_device
from compensate.master import Figures, Posed, Solution, Stage, solve_frame
from compensate.methods import Solver, perceptual, require_method
from compensate.softening import Softening
from compensate.visible import OnlyVisible
from compensate.vision.csf import LowFrequencyFloor
from compensate.weighting import PerceptualWeighting
from domesim.batch.work import Column, Note, Recipe, Work, Write
from domesim.choice import SceneChoice
from domesim.errors import InputError
from domesim.frames import Master
from domesim.scene import Scene, StereoScene

PAPER, CONTRAST, CONTOURS = "paper", "contrast", "contours"
"""Names of the vision models."""

INVISIBLE = 0.01
"""JND rms of rounding that is not worth a word."""

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
        Of the perceptual method.
    eye
        Name of the vision model: "paper", "contrast" or, of a pair, "contours".
    low_frequency_gain
        Of the vision model; None for its own.
    device
        What computes.
    only_visible
        Solve only where what subtraction leaves is predicted to be seen.
    """

    scene: SceneChoice
    method: str = "perceptual"
    tolerance: float = 1e-3
    eye: str = PAPER
    low_frequency_gain: float | None = None
    device: str = CPU
    only_visible: bool = False

    def work(self, note: Note) -> Work[Any, Any]:
        """See `Recipe`."""
        theatre = self.scene.load()
        solver = self.solver(theatre, note)
        stage = Stage(theatre, weighting_of(self.eye, self.low_frequency_gain))

        def prepare(source: Master) -> tuple[Master, Posed, float]:
            return source, *stage.pose_frame(source)

        def solve(given: tuple[Master, Posed, float]) -> Solution:
            source, posed, out_of_range = given
            chosen = OnlyVisible(posed, solver) if self.only_visible and solver else solver
            return solve_frame(source, posed, out_of_range, self.method, chosen)

        return Work(prepare, solve, _end)

    def require_sense(self, theatre: Scene) -> None:
        """See that the settings go together.

        Raises
        ------
        InputError
            If they do not.
        """
        weighting_of(self.eye, self.low_frequency_gain)
        if self.eye == CONTOURS and not isinstance(theatre, StereoScene):
            raise InputError(
                f"--weighting {CONTOURS}: ghosts are a stereo pair's; a dome takes {CONTRAST}"
            )
        require_method(self.method, theatre)
        if not 0 < self.tolerance < 1:
            raise InputError(f"tolerance must lie between 0 and 1, got {self.tolerance:g}")
        if self.only_visible:
            table = isinstance(theatre, StereoScene) and theatre.table is not None
            if self.method != "perceptual" or theatre.several_seats or table or self.device != CPU:
                raise InputError(
                    "--only-visible is for --method perceptual, one seat without a grey-to-grey "
                    "table, and the processor; leave it out"
                )
        if self.method != "perceptual":
            if self.device != CPU:
                raise InputError(
                    f"--device {self.device}: {self.method} is computed on the processor only"
                )
            if theatre.several_seats and self.scene.seat == "worst":
                raise InputError(
                    f"--seat worst: {self.method} knows one seat or the mean of all; use "
                    f"--seat all, name one, or leave --method out"
                )

    def solver(self, theatre: Scene, note: Note) -> Solver | None:
        """The perceptual method's solver, or None for the others' own.

        Raises
        ------
        InputError
            If the settings do not go together, or there is no such device.
        """
        self.require_sense(theatre)
        if self.method != "perceptual":
            return None

        def progress(iteration: int, gap: float) -> None:
            note(f"iteration {iteration}, within {gap:.1e} of the optimum")

        worst = self.scene.seat == "worst"
        solver = perceptual(theatre, self.tolerance, worst=worst, progress=progress)
        return on_device(solver, self.device)

    def settings(self) -> dict[str, Any]:
        """See `Recipe`."""
        settings = {name: value for name, value in vars(self).items() if name != "scene"}
        return {"command": "compensate", **self.scene.settings(), **settings}

    def columns(self) -> tuple[Column, ...]:
        """See `Recipe`."""
        return (
            Column("error_after", "Visible error", "JND rms"),
            Column("error_subtractive", "if subtracted", "JND rms"),
            Column("error_before", "untouched", "JND rms"),
            Column("clipped", "Too dark", "%"),
            Column("out_of_range", "Out of range", "%"),
        )

    def memory(self, rows: int, cols: int) -> int:
        """See `Recipe`: planes of one view, as measured (at 8192 x 8192, 45 for a dome)."""
        planes = 75 if self.scene.load().views == 1 else 160
        return 500_000_000 + planes * 4 * rows * cols

    def resources(self) -> dict[str, float]:
        """See `Recipe`: a GPU, if one computes."""
        on_gpu = self.device.partition(":")[0] in ("cuda", "cupy")
        return {"GPU": 1} if on_gpu else {}

    compares = True

    def compare(self, master: Master, page: Path) -> None:
        """See `Recipe`: master, and what is seen untouched and compensated."""
        theatre = self.scene.load()
        weighting = weighting_of(self.eye, self.low_frequency_gain)
        solver = None
        if self.method == "perceptual":
            solver = self.solver(theatre, lambda text: None)
        comparison = compare_methods(master, theatre, solver=solver, weighting=weighting)
        comparison.write_page(page, size=SIZE, command=f"domesim compensate --scene {theatre.name}")


def preferred(theatre: Scene) -> str:
    """The vision model for those who name none (``validation/notes/0007``)."""
    return PAPER if theatre.several_seats else CONTRAST


def weighting_of(name: str, low_frequency_gain: float | None = None) -> Eye:
    """The vision model of that name.

    Raises
    ------
    InputError
        If there is none.
    """
    settings: dict[str, Callable[..., Eye]] = {
        PAPER: PerceptualWeighting,
        CONTRAST: ContrastWeighting,
        # Whatever ghosts stand out from (validation/notes/0007)
        CONTOURS: partial(
            ContrastWeighting, softening=Softening(1.8, reach=0.3, contrast=1e3, firmness=0)
        ),
    }
    if name not in settings:
        raise InputError(f"--weighting {name!r} is not known; use one of {', '.join(settings)}")
    if low_frequency_gain is None:
        return settings[name]()
    return settings[name](LowFrequencyFloor(low_frequency_gain))


def _end(solution: Solution, write: Write) -> tuple[dict[str, Any], str]:
    """Write it; of what subtraction shows, only figures that take no longer than that."""
    outcome = solution.outcome(brief=True)
    write(outcome.frame)
    found = outcome.figures
    del outcome  # its frame is as large as what is read below
    figures, line = asdict(found), line_of(found)
    if found.error_before is None:
        return {**figures, "error_stored": None}, line
    stored = write.stored()
    error = solution.posed.stored_error(stored)
    line += f" As stored: {error:.3g} JND rms"
    if error > 1.1 * found.error_after and error > INVISIBLE:
        line += f" (rounding to {stored.bits} bit {stored.path.suffix} shows: --format, --bits)"
    return {**figures, "error_stored": error}, line


def line_of(f: Figures) -> str:
    """What was done and how good it is, for a person."""
    parts = [f"{f.method}: {f.pollution:.2g} cd/m² of pollution, subtracted"]
    if f.error_before is not None:
        parts = [
            f"{f.method}: visible error {f.error_before:.3g} -> {f.error_after:.3g} JND rms "
            f"(subtractive {f.error_subtractive:.3g})",
            f"{f.clipped:.1%} of the screen too dark for exact subtraction",
        ]
    if f.error_by_seat:
        seats = ", ".join(f"{name} {error:.3g}" for name, error in f.error_by_seat.items())
        parts.append(f"by seat: {seats}")
    if f.out_of_range:
        parts.append(f"{f.out_of_range:.1%} out of the projector's range")
    if f.file_clipped:
        parts.append(f"{f.file_clipped:.1%} out of the file's colour range and clipped")
    if f.gap is not None:
        line = f"within {f.gap:.1e} of the optimum after {f.iterations} iterations"
        if f.distance:
            line += f" (what is seen, within {f.distance:.2g} JND rms)"
        parts.append(line)
    parts.append(f"{f.seconds:.1f} s. {f.status}")
    if f.light_left is not None and f.error_left is not None:
        low, likely, high = (100 * light for light in f.light_left)
        least, error, most = f.error_left
        parts.append(
            f"as sure as the room was measured, {likely:.3g} % of white are left (95 %: "
            f"{low:.3g} to {high:.3g}), visible error {error:.3g} ({least:.3g} to {most:.3g})"
        )
    return "; ".join(parts)
