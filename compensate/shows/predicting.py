"""What ``domesim predict`` does to each frame: tells whether it needs compensation, and where.

For each frame it writes the maps of `compensate.prediction` twice: as an EXR of floats, and as the
four pictures of the paper's Fig. 8, to look at.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias, final

import numpy as np

from compensate.plain import PlainRuler
from compensate.pose import Posed, Stage
from compensate.prediction import (
    Planes,
    Prediction,
    Triage,
    Verdict,
    probability,
    reduction,
    regions,
    triage,
)
from compensate.report_card import losses
from compensate.shows.cues import chosen, lost_by
from compensate.shows.eyes import doubt
from compensate.shows.over_time import timeline
from domesim.frames import ColourTag, Master
from domesim.frames.formats import FORMATS
from domesim.frames.formats.exr import written
from domesim.frames.formats.png import colour_chunks, with_colour_chunks
from domesim.frames.writing import bare_specification
from domesim.host.writing import write_together
from domesim.inspection.magnitudes import SOURCES, Faintest
from domesim.light.blocks import light_means
from domesim.light.strips import converted
from domesim.observation.stereo import VIEWS
from domesim.scene.choice import SceneChoice
from domesim.scene.screening import averaged_on_screen
from domesim.shows.run import Done
from domesim.shows.small import thinned
from domesim.shows.timeline import Timeline
from domesim.shows.work import Column, Files, Judged, Note, Recipe, Work, Write, Writing

MAPS = ".maps.exr"
"""What the EXR's name ends in: it must not replace a frame that another command wrote there."""

CHANNELS = ("TVI", "masking", "saliency", "prediction", "mask", "subtracted")
"""Channels of the EXR: the maps of `Predicted`, and the mask of what subtraction leaves."""

PICTURES = {
    "tvi": "Light pollution over its threshold at the local luminance; grey: at it, white: twice.",
    "masking": "Whether the eye's mechanisms tell polluted from not; grey: at threshold.",
    "saliency": "Where a viewer looks first; of a pair, in the other eye's picture.",
    "prediction": "White: visible pollution that subtraction leaves; grey: that it removes.",
}
"""Fig. 8, a to d: names and captions."""

LARGEST = 1024
"""Longest side of a map in a picture, pixels."""

GAP = 4
"""Between the halves of a picture, pixels."""

MOST = np.finfo(np.float16).max
"""What a map holds at most."""

BRIGHTEST = 4096
"""What a residual is brightened by at most."""

MARGIN = 1.0
"""Around what is to be solved, degrees."""

TOLD = 5
"""Worst frames that the summary names."""


@final
@dataclass(frozen=True)
class Predicting(Recipe):
    """Maps of visible pollution of each frame.

    Parameters
    ----------
    scene
        The theatre, or stereo system of one seat.
    prediction
        The settings of `triage`.
    """

    scene: SceneChoice
    prediction: Prediction

    def work(self, note: Note) -> Work[Any, Any]:
        """See `Recipe`."""
        theatre = self.scene.load()
        stage = Stage(theatre)

        def solve(prepared: tuple[Posed, int]) -> tuple[Posed, int, Triage, Lost]:
            return *prepared, *_judged(prepared[0], self.prediction)

        def end(
            solved: tuple[Posed, int, Triage, Lost], write: Write
        ) -> tuple[dict[str, Any], str]:
            posed, step, frame_triage, lost = solved
            places = _places_of(write.output, theatre.views)
            brightened = _write(places, posed, frame_triage)
            figures = {**_figures(posed, frame_triage, step), "lost": lost, "gained": _gained(lost)}
            pictures = [path for place in places for path in place.pictures]
            write.beside(pictures)
            _write_small(write, posed, frame_triage)
            told = {"pictures": [str(path) for path in pictures], "brightened": brightened}
            return {**figures, **told}, _line(figures)

        def prepare(source: Master) -> tuple[Posed, int]:
            size = source.frames[0].pixels.shape[:2]
            step = reduction(theatre, self.prediction, *size)
            return stage.pose(averaged_on_screen(source, theatre, step)), step

        return Work(prepare, solve, end)

    def settings(self) -> dict[str, Any]:
        """See `Recipe`."""
        settings = asdict(self.prediction)
        values = {name: getattr(value, "value", value) for name, value in settings.items()}
        values["threshold"] = self.prediction.least
        return {"command": "predict", **self.scene.settings(), **values}

    def beside(self, output: Files) -> Sequence[Path]:
        """See `Recipe`."""
        places = _places_of(output, self.scene.load().views)
        return [path for place in places for path in place.pictures]

    @property
    def about(self) -> str:
        """See `Recipe`: what becomes of light without a picture."""
        theatre = self.scene.load()
        return f"{theatre.name}: {theatre.graded}"

    def doubt(self, masters: Iterable[Master]) -> str | None:
        """See `Recipe`: whether left and right belong together."""
        return doubt(masters, self.scene.load())

    small = "The master, and the prediction: white is what subtraction leaves, grey it removes"

    def options(self, writing: Writing) -> dict[str, str]:
        """See `Recipe`."""
        chosen = self.prediction
        return {
            **self.scene.options(),
            "--combination": chosen.combination.value,
            "--threshold": f"{chosen.least:g}",
            "--saliency" if chosen.counts_saliency else "--no-saliency": "yes",
            "--mesopic": chosen.blend.value,
            **({} if chosen.eye is None else {"--age": f"{chosen.eye.age:g}"}),
            **({"--repair": "yes"} if writing.repair else {}),
        }

    def judged(self, figures: Mapping[str, Any]) -> Judged | None:
        """See `Recipe`: the verdict of `triage`."""
        verdict = Verdict[figures["verdict"].upper()]
        reason = (
            f"pollution is visible on {_percent(figures['visible'])} of the screen, "
            f"after subtraction on {_percent(figures['visible_subtracted'])}"
        )
        return Judged(verdict.value, reason, _NEEDS[verdict])

    def over_time(
        self, frames: Sequence[Mapping[str, Any]], seconds: Sequence[float]
    ) -> Timeline | None:
        """See `Recipe`: black, and stars, of what is seen untouched."""
        return timeline(
            [frame.get("dark") for frame in frames], seconds, {"untouched": "untouched"}
        )

    def columns(self) -> tuple[Column, ...]:
        """See `Recipe`."""
        return (
            Column("gained", "To be gained", "JOD"),
            Column("visible_subtracted", "Visible after subtraction", "%"),
            Column("visible", "Visible untouched", "%"),
        )

    def memory(self, rows: int, cols: int) -> int:
        """See `Recipe`: a quarter more than measured."""
        theatre = self.scene.load()
        step = reduction(theatre, self.prediction, rows, cols)
        return 150_000_000 + theatre.views * (80 // step**2 + 6) * 4 * rows * cols


Lost: TypeAlias = dict[str, float] | None
"""JOD that each method loses; None where nothing is visible."""

_NEEDS = {Verdict.NOTHING: 0, Verdict.LEAVE: 1, Verdict.SUBTRACT: 1, Verdict.COMPENSATE: 2}


def _judged(posed: Posed, settings: Prediction) -> tuple[Triage, Lost]:
    """The triage of a frame; what is visible is advised only where it looks better than untouched.

    The second value is what the methods lose.
    """
    found = triage(posed, settings)
    if found.verdict is Verdict.NOTHING:
        return found, None
    lost = losses(posed)
    better = {"none": Verdict.LEAVE, "subtractive": Verdict.SUBTRACT}
    return replace(found, verdict=better.get(chosen([lost]), found.verdict)), lost


def _gained(lost: Lost) -> float:
    """JOD that the best method gains over untouched; 0 where nothing is visible."""
    return 0.0 if lost is None else lost["none"] - min(lost.values())


# Where it goes.


@final
@dataclass(frozen=True)
class _Place:
    """Where the maps of one view go, or of several that lie in one file."""

    maps: Path
    views: dict[str, int]  # by what tells them apart in names: "left."

    def picture(self, name: str, kind: str) -> Path:
        """File of the picture of one view and of one kind of `PICTURES`."""
        return self.maps.with_name(f"{self.maps.name.removesuffix(MAPS)}.{name}{kind}.png")

    @property
    def pictures(self) -> list[Path]:
        """All of them."""
        return [self.picture(name, kind) for name in self.views for kind in PICTURES]


def _places_of(outputs: tuple[Path, ...], views: int) -> list[_Place]:
    """Where the maps of one moment go."""
    if len(outputs) < views:
        names = VIEWS if views == len(VIEWS) else [f"view{k:02}" for k in range(1, views + 1)]
        return [_Place(outputs[0], {f"{each}.": k for k, each in enumerate(names)})]
    return [_Place(output, {"": k}) for k, output in enumerate(outputs)]


# What is written.


def _write(places: list[_Place], posed: Posed, triage: Triage) -> int:
    """Write all files of a frame at once; by what the residual is brightened."""
    maps, white = triage.untouched, posed.scene.projector.white
    brightened = _brightening(maps.residual[:, posed.screen] / white)
    contents = []
    for place in places:
        contents.append((place.maps, _exr(place, triage)))
        for name, view in place.views.items():
            ghost = np.abs(maps.residual[view]) * (brightened / white)
            for kind, shown in _shown(triage, view).items():
                caption = f"{PICTURES[kind]} Left: the map. Right: the map times the pollution's "
                caption += f"light, {brightened} times brighter."
                path = place.picture(name, kind)
                contents.append((path, _png(path, shown, ghost, caption)))
    write_together(contents)
    return brightened


def _write_small(write: Write, posed: Posed, triage: Triage) -> None:
    prediction = thinned(_prediction(triage, 0)[None, :, :, None])[0]
    master = posed.scene.projector.to_display(thinned(posed.desired))[0]
    write.small(master, np.broadcast_to(prediction, master.shape) ** 2.2)


def _shown(triage: Triage, view: int) -> dict[str, Planes]:
    """The maps as they are shown, 0..1."""
    maps = triage.untouched
    return {
        "tvi": np.minimum(maps.tvi[view] / 2, 1),
        "masking": probability(maps.masking[view]),
        "saliency": maps.saliency[view],
        "prediction": _prediction(triage, view),
    }


def _prediction(triage: Triage, view: int) -> Planes:
    """White is what subtraction leaves, grey what it removes."""
    remaining, mask = triage.subtracted.mask[view], triage.untouched.mask[view]
    return np.where(remaining, 1, np.float32(0.5) * mask)


def _brightening(residual: Planes) -> int:
    """The power of two that brings all but a thousandth of the screen below white."""
    bright = float(np.quantile(np.abs(residual), 0.999)) if residual.size else 0.0
    if bright * BRIGHTEST <= 1:
        return BRIGHTEST
    return int(2 ** max(0, np.floor(np.log2(1 / bright))))


def _png(path: Path, plane: Planes, ghost: Planes, caption: str) -> bytes:
    """A map beside itself times the ghost, as sRGB."""
    step = -(-max(plane.shape) // LARGEST)
    small, light = light_means(np.stack([plane, plane * ghost])[..., None], step)
    gap = np.ones((len(light), GAP, 1), np.float32)
    picture = np.hstack([small, gap, np.minimum(light, 1) ** (1 / 2.2)])
    codes = np.rint(picture * 255).astype(np.uint8)
    attributes = [("ImageDescription", "string", caption)]
    spec = bare_specification(("Y",), ("uint8",), (codes.shape[1], codes.shape[0]), attributes)
    png = FORMATS["png"].encoded(path, spec, codes)
    return with_colour_chunks(png, colour_chunks(ColourTag("srgb", "BT.709", "computed")))


def _exr(place: _Place, triage: Triage) -> bytes:
    """All maps of the views of a file, as half channels: no more than `MOST`."""
    maps = triage.untouched
    each = (
        maps.tvi,
        maps.masking,
        maps.saliency,
        maps.prediction,
        maps.mask,
        triage.subtracted.mask,
    )
    names = tuple(f"{name}{channel}" for name in place.views for channel in CHANNELS)
    planes = (map_[k] for k in place.views.values() for map_ in each)
    halves = [converted(np.minimum(plane, MOST), np.dtype(np.float16)) for plane in planes]
    return written(place.maps, [({}, dict(zip(names, halves, strict=True)))])


# What is said.


def _figures(posed: Posed, triage: Triage, step: int) -> dict[str, Any]:
    """Figures of a frame: see `Predicted` and `Triage`; regions in pixels of the master."""
    density = posed.scene.viewing.pixels_per_degree(*posed.screen.shape)
    boxes = regions(triage.subtracted.mask, round(MARGIN * density))
    return {
        "visible": triage.untouched.share,
        "visible_by_view": list(triage.untouched.visible.shares),
        "visible_salient": triage.untouched.salient,
        "visible_subtracted": triage.subtracted.share,
        "visible_subtracted_by_view": list(triage.subtracted.shares),
        "verdict": triage.verdict.name.lower(),
        "regions": [
            [step * edge for side in box for edge in (side.start, side.stop)] for box in boxes
        ],
        **_sky(posed),
    }


def _sky(posed: Posed) -> dict[str, Any]:
    """Black of the master, and as it is seen untouched; and a dome's faintest stars there."""
    views = slice(posed.scene.views)
    ruler = PlainRuler(posed.wanted[views], posed.scene, posed.screen)
    small = posed.setting.overview.of(posed.desired).small[views]
    blacks = {"master": ruler.black(posed.wanted[views]), "untouched": ruler.black(small)}
    stars = {name: ruler.faintest(black) for name, black in blacks.items()}
    dark = blacks | {f"star_{name}": each and each.crumey for name, each in stars.items()}
    told = {f"faintest_star_{name}": each for name, each in stars.items()}
    told |= {f"projected_star_{name}": ruler.projected(black) for name, black in blacks.items()}
    return {"dark": dark, **{name: each._asdict() for name, each in told.items() if each}}


def _line(figures: dict[str, Any]) -> str:
    verdict = Verdict[figures["verdict"].upper()].value
    line = (
        f"visible pollution on {_percent(figures['visible'])} of the screen, "
        f"{_percent(figures['visible_subtracted'])} after subtraction: {verdict}"
    )
    if figures["verdict"] == Verdict.LEAVE.name.lower():
        line = f"{line} (JOD lost: {lost_by(figures['lost'])})"
    if "faintest_star_master" not in figures:
        return line
    falls = [
        " down to ".join(
            Faintest(**figures[f"{key}_{name}"]).told for name in ("master", "untouched")
        )
        for key in ("faintest_star", "projected_star")
        if f"{key}_master" in figures
    ]
    projected = "".join(f", the star projector's from {fall}" for fall in falls[1:])
    return f"{line}. The faintest star falls from {falls[0]} mag{projected} ({SOURCES})"


def _percent(share: float) -> str:
    """Two digits, but never 0 for something."""
    return f"{share:.2%}" if 0 < share < 0.1 else f"{share:.0%}"


def worst(done: Done) -> list[dict[str, Any]]:
    """The frames, those first that gain most; of equal ones in their order."""
    return sorted(done.frames, key=lambda frame: -float(frame["gained"]))


def summary_of(done: Done, frames: list[dict[str, Any]]) -> str:
    """Sums up all frames in a line, the worst of `frames` first."""
    counts = Counter(frame["verdict"] for frame in done.frames)
    parts = [f"{count} {each.value}" for each in Verdict if (count := counts[each.name.lower()])]
    named = [
        f"{_name(frame['input'])} ({frame['gained']:.2f} JOD; visible on "
        f"{_percent(frame['visible'])}, {_percent(frame['visible_subtracted'])} after subtraction)"
        for frame in frames[:TOLD]
        if frame["verdict"] != Verdict.NOTHING.name.lower()
    ]
    text = f"{len(done.frames)} frames: {'; '.join(parts)}"
    return f"{text}. Most to be gained: {', '.join(named)}" if named else text


def _name(source: str | list[str]) -> str:
    return Path(source if isinstance(source, str) else source[0]).name
