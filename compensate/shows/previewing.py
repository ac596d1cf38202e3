"""A film for whoever decides: what a seat sees untouched, subtracted and compensated.

Frames are made by workers, as pictures in a folder that is thrown away; the film is made of them in
order, with figures of the whole show and the place of the frame under them. The figures are those
of reports (`compensate.shows.over_time`).
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from compensate.figures import Appraisal
from compensate.pose import Posed, Stage
from compensate.ruler import whole_block_of
from compensate.shows.eyes import doubt
from compensate.shows.over_time import timeline
from compensate.solve import solved
from domesim.errors import InputError
from domesim.frames import ColourTag, Frame, Master, read_frame, write_frame
from domesim.frames.dithering import dither, seed_of
from domesim.frames.film import write_film
from domesim.frames.frame import as_codes
from domesim.frames.timing import Timing
from domesim.host.console import Console
from domesim.host.numbers import decimal
from domesim.light import Light
from domesim.light.transfer import SRGB
from domesim.observation.stereo import VIEWS
from domesim.scene.choice import SceneChoice
from domesim.scene.screening import averaged_on_screen
from domesim.shows.first_look import look
from domesim.shows.run import Running, crew_of, figures_of_all, orders_of
from domesim.shows.show import Show
from domesim.shows.timeline import Panel, begin_at_zero
from domesim.shows.work import Column, Note, Order, Recipe, Work, Write, Writing

WAYS = {"none": "untouched", "subtractive": "subtracted", "perceptual": "compensated"}
"""Methods that are shown, from left to right, and their captions."""
SIZE = 1920, 1080
"""Columns and rows of the film."""
_GRAPH = 340  # rows of the figures
_CAPTION = 48  # rows
_GAP = 8  # columns between pictures
_COLOUR = ColourTag("srgb", "BT.709", "domesim")


@final
@dataclass(frozen=True)
class Brightness:
    """How light becomes code values.

    Parameters
    ----------
    display
        White of the display that shows the film, cd/m², on which light is as it is in the theatre;
        None if it is exposed.
    stops
        How much brighter than with the theatre's white as the film's, stops of two.
    """

    display: float | None = None
    stops: float = 0.0

    def __post_init__(self) -> None:
        if self.display is not None and not 0 < self.display < np.inf:
            raise InputError(f"--display must be above 0 cd/m², got {self.display:g}")
        if not abs(self.stops) <= 20:
            raise InputError(f"--exposure must lie within -20 and 20 stops, got {self.stops:g}")
        if self.display is not None and self.stops:
            raise InputError("--display and --exposure: wanted one of them, got both")

    def gain(self, white: float) -> float:
        """By what light is multiplied, where 1 is the theatre's white, cd/m²."""
        return 2**self.stops if self.display is None else white / self.display

    def told(self, white: float) -> str:
        """Says which it is."""
        if self.display is not None:
            return f"as bright as in the theatre on a display of {self.display:g} cd/m²"
        told = f"white is the theatre's, {decimal(white)} cd/m²"
        return f"{told}, {self.stops:+g} stops" if self.stops else told


@final
@dataclass(frozen=True)
class Previewing(Recipe):
    """Pictures of what is seen by each of `WAYS`, and figures; the first eye's of a pair.

    Parameters
    ----------
    scene
        The theatre, or stereo system, from one seat.
    brightness
        How light becomes code values.
    wipe
        Whether untouched and compensated are shown in one place, divided by a line that moves.
    """

    scene: SceneChoice
    brightness: Brightness
    wipe: bool = False

    def work(self, note: Note) -> Work[Any, Any]:
        """See `Recipe`."""
        theatre = self.scene.load()
        stage = Stage(theatre)

        def prepare(source: Master) -> tuple[Path, Posed]:
            step = whole_block_of(*source.frames[0].pixels.shape[:2])
            return source.path, stage.pose(averaged_on_screen(source, theatre, step))

        def solve(given: tuple[Path, Posed]) -> tuple[Path, Posed, dict[str, Light]]:
            return *given, {way: solved(given[1], way).light for way in WAYS}

        def end(
            found: tuple[Path, Posed, dict[str, Light]], write: Write
        ) -> tuple[dict[str, Any], str]:
            path, posed, lights = found
            self._write(write.output[0], path, posed, lights)
            return _figures(posed, lights), ""

        return Work(prepare, solve, end)

    def _write(self, place: Path, source: Path, posed: Posed, lights: Mapping[str, Light]) -> None:
        """Write the pictures beside each other, 8 bits, dithered, as nothing else hides steps."""
        ways = [way for way in WAYS if not self.wipe or way != "subtractive"]
        cols, rows = self.box
        projector = posed.scene.projector
        gain = np.float32(self.brightness.gain(projector.white))
        pictures = []
        for way in ways:
            seen = projector.to_display(posed.seen(lights[way])[:1])[0]
            light = fitted(np.asarray(seen, np.float32), cols, rows)
            pictures.append(SRGB().encode(np.clip(light * gain, 0, 1)))
        codes = np.ascontiguousarray(255 * np.hstack(pictures), np.float32)
        dither(codes, 255, seed_of(source, 0))
        write_frame(Frame(as_codes(codes / 255), place, _COLOUR, 8, floating=False), place)

    @property
    def box(self) -> tuple[int, int]:
        """Columns and rows that a picture has at most."""
        across = 1 if self.wipe else len(WAYS)
        return (SIZE[0] - (across - 1) * _GAP) // across, SIZE[1] - _GRAPH - _CAPTION

    def doubt(self, masters: Iterable[Master]) -> str | None:
        """See `Recipe`: whether left and right belong together."""
        return doubt(masters, self.scene.load())

    def settings(self) -> dict[str, Any]:
        """See `Recipe`."""
        return {"command": "preview", **self.scene.settings(), "wipe": self.wipe}

    def columns(self) -> tuple[Column, ...]:
        """See `Recipe`."""
        return ()

    def memory(self, rows: int, cols: int) -> int:
        """See `Recipe`."""
        return 500_000_000 + 12 * 4 * rows * cols


def fitted(light: NDArray[np.float32], cols: int, rows: int) -> NDArray[np.float32]:
    """Resizes a picture (row, col, primary) to a box of so many columns and rows, by area."""
    from PIL import Image  # noqa: PLC0415 - slow to import

    factor = min(cols / light.shape[1], rows / light.shape[0])
    size = max(1, int(light.shape[1] * factor)), max(1, int(light.shape[0] * factor))
    planes = [
        np.asarray(Image.fromarray(plane).resize(size, Image.Resampling.BOX))
        for plane in np.moveaxis(light, -1, 0)
    ]
    return np.stack(planes, axis=-1)


def _figures(posed: Posed, lights: Mapping[str, Light]) -> dict[str, Any]:
    """Black, stars and light, cd/m², of the master and of each way."""
    appraisal, dark = Appraisal(posed), dict[str, float | None]()
    for way, light in lights.items():
        found = appraisal.dark(appraisal.look(light))
        dark |= {"master": found.master, "star_master": found.star_master}
        dark |= {way: found.seen, f"star_{way}": found.star_seen}
    luminance = posed.scene.projector.luminance(posed.desired)[:1, posed.screen]
    return {"dark": dark, "light": float(luminance.mean(dtype=np.float64))}


def write_preview(
    show: Show,
    path: Path,
    recipe: Previewing,
    console: Console,
    *,
    timing: Timing,
    sound: Path | None = None,
    running: Running,
    repair: bool = False,
) -> list[dict[str, Any]]:
    """Makes the film of a show.

    Parameters
    ----------
    show
        The masters.
    path
        The film, .mp4.
    recipe
        What is shown of each.
    console
        Who is told.
    timing
        When frames are shown.
    sound
        A video whose sound it gets; None for none.
    running
        Who makes the frames.
    repair
        Whether impossible samples of masters are repaired.

    Returns
    -------
    figures
        Of each frame: ``dark`` and ``light``.

    Raises
    ------
    InputError
        If a master cannot be read, its frames are doubted (`Recipe.doubt`), or the film cannot be
        written.
    """
    look(show, recipe, path.parent, repair=repair)
    theatre = recipe.scene.load()
    with tempfile.TemporaryDirectory(prefix=".domesim-", dir=path.parent) as scratch:
        # The picture goes to the first; others are what a result of such masters has
        places = [
            tuple(Path(scratch, f"{k}.{view}.png") for view in range(len(moment)))
            for k, moment in enumerate(show.moments)
        ]
        orders = orders_of(show, places, recipe, Writing(".png", repair=repair))
        figures = figures_of_all(orders, crew_of(running, recipe, show), console, "previewing")
        seconds = [float(k / timing.rate) for k in range(len(orders))]
        graph = Graph(figures, seconds)
        told = recipe.brightness.told(theatre.projector.white)
        eye = f", {VIEWS[0]} eye" if theatre.views > 1 else ""
        page = _Sheet(recipe.wipe, f"{theatre.name}{eye}: {told}")
        with console.progress("assembling", len(orders)) as start:
            frames = _frames(orders, seconds, page, graph, start)
            count = len(orders)
            write_film(path, frames, count, _COLOUR, timing, sound=sound)
    return figures


def _frames(
    orders: Sequence[Order],
    seconds: Sequence[float],
    sheet: _Sheet,
    graph: Graph,
    start: Callable[[str], None],
) -> Iterator[Frame]:
    for order, second in zip(orders, seconds, strict=True):
        start(order.name)
        frame = read_frame(order.output[0])
        codes = np.rint(255 * frame.pixels).astype(np.uint8)
        whole = sheet.around(codes, order.moment[0].name, second, graph.at(second))
        yield replace(frame, pixels=as_codes(whole / 255), colour=_COLOUR)


WIPES = 8.0
"""Seconds in which the dividing line goes to and fro."""


@final
class _Sheet:
    """Puts pictures, captions and figures on one sheet."""

    def __init__(self, wipe: bool, told: str) -> None:
        self._wipe, self._told = wipe, told
        titles = ["untouched | compensated"] if wipe else list(WAYS.values())
        self._room = SIZE[0] // len(titles)
        captions = np.hstack([_written(title, self._room, 26) for title in titles])
        self._empty = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
        self._empty[: len(captions)] = captions

    def around(
        self, pictures: NDArray[np.uint8], name: str, second: float, graph: NDArray[np.uint8]
    ) -> NDArray[np.uint8]:
        """A frame of the film, (row, col, 3)."""
        sheet, room = self._empty.copy(), self._room
        parts = np.split(pictures, 2 if self._wipe else len(WAYS), axis=1)
        if self._wipe:
            untouched, compensated = parts
            cols = untouched.shape[1]
            line = round(abs(1 - 2 * (second / WIPES % 1)) * cols)
            both = np.hstack([untouched[:, :line], compensated[:, line:]])
            both[:, max(0, line - 1) : line + 1] = 128
            parts = [both]
        for k, part in enumerate(parts):
            rows, cols = part.shape[:2]
            left = k * room + (room - cols) // 2
            top = _CAPTION + (SIZE[1] - _GRAPH - _CAPTION - rows) // 2
            sheet[top : top + rows, left : left + cols] = part
        note = _written(f"{self._told}    {name}", SIZE[0], 18)
        sheet[SIZE[1] - len(note) :] = note
        top = SIZE[1] - len(note) - len(graph)
        sheet[top : top + len(graph)] = graph
        return sheet


def _written(text: str, width: int, size: int) -> NDArray[np.uint8]:
    """A line of text in the middle of a strip, (row, col, 3)."""
    from matplotlib.font_manager import findfont  # noqa: PLC0415 - slow to import
    from PIL import Image, ImageDraw, ImageFont  # noqa: PLC0415

    strip = Image.new("RGB", (width, round(1.7 * size)))
    font = ImageFont.truetype(findfont("DejaVu Sans"), size)  # Pillow's own has no ²
    middle = (width // 2, strip.height // 2)
    ImageDraw.Draw(strip).text(middle, text, (190, 190, 190), font, anchor="mm")
    return np.asarray(strip)


@final
class Graph:
    """Figures of a whole show, drawn once, and a line where a frame is.

    Parameters
    ----------
    figures
        Of each frame, as of `write_preview`.
    seconds
        Time of each.
    """

    def __init__(self, figures: Sequence[Mapping[str, Any]], seconds: Sequence[float]) -> None:
        self._picture, self._places = _drawn(_panels(figures, seconds), seconds)

    def at(self, second: float) -> NDArray[np.uint8]:
        """(row, col, 3) codes of the graph with a line at that time."""
        picture = self._picture.copy()
        for rows, zero, one in self._places:
            at = round(zero + (one - zero) * second)
            picture[rows, at : at + 2] = np.maximum(picture[rows, at : at + 2], 150)
        return picture


def _panels(figures: Sequence[Mapping[str, Any]], seconds: Sequence[float]) -> list[Panel]:
    light = Panel("light of the master, cd/m²", {"master": [each["light"] for each in figures]})
    over_time = timeline([each["dark"] for each in figures], seconds, WAYS)
    return [light] if over_time is None else [*over_time.panels, light]


def _drawn(
    panels: Sequence[Panel], seconds: Sequence[float]
) -> tuple[NDArray[np.uint8], list[tuple[slice, float, float]]]:
    """The panels beside each other; rows, and columns of 0 s and 1 s, of each."""
    from matplotlib import style  # noqa: PLC0415 - slow to import
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415

    with style.context(["dark_background", {"font.size": 11}]):
        rows = _GRAPH - round(1.7 * 18)
        figure = Figure((SIZE[0] / 100, rows / 100), dpi=100, layout="constrained")
        canvas = FigureCanvasAgg(figure)
        grid = figure.subplots(1, len(panels), squeeze=False)[0]
        for axes, panel in zip(grid, panels, strict=True):
            for name, line in panel.lines.items():
                values = [np.nan if value is None else value for value in line]
                axes.plot(seconds, values, color=_COLOURS[name], label=name, linewidth=1.8)
            if panel.from_zero:
                begin_at_zero(axes)
            axes.set_title(panel.label.replace("\n", " "), fontsize=12)
            axes.margins(x=0.01)
            axes.set_xlabel("seconds")
        figure.legend(
            *grid[0].get_legend_handles_labels(), loc="outside right upper", frameon=False
        )
        canvas.draw()  # type: ignore[no-untyped-call]
        picture = np.array(canvas.buffer_rgba())[..., :3]  # type: ignore[no-untyped-call]
        places = []
        for axes in grid:
            zero, one = (float(axes.transData.transform((at, 0))[0]) for at in (0.0, 1.0))
            box = axes.bbox
            places.append((slice(rows - round(box.y1), rows - round(box.y0)), zero, one))
    return picture, places


_COLOURS = {
    "master": "#c8c8c8",
    "untouched": "#e08a2e",
    "subtracted": "#3f8fd8",
    "compensated": "#4fc07b",
}
