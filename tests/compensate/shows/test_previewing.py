"""The film for whoever decides, decoded by FFmpeg."""

from __future__ import annotations

import json
import sys
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from command_line import Run

from compensate.pose import Stage
from compensate.shows import previewing
from compensate.shows.previewing import SIZE, WAYS, Brightness, Previewing, fitted
from compensate.solve import solved
from domesim.errors import InputError
from domesim.frames import ColourTag, Frame, read_frame, read_master, write_frame
from domesim.light.transfer import SRGB
from domesim.scene import load_scene
from domesim.scene.choice import SceneChoice
from domesim.scene.screening import decoded
from domesim.shows.show import find_show
from domesim.shows.timeline import Panel
from domesim.shows.work import Order, Steps, Writing

SIDE, COUNT = 96, 6
COLOUR = ColourTag("srgb", "BT.709", "made")


@pytest.fixture(scope="module")
def masters(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A disc that rises over a dark sky."""
    folder = tmp_path_factory.mktemp("masters")
    row, col = np.mgrid[:SIDE, :SIDE] / SIDE - 0.5
    for k in range(COUNT):
        disc = np.hypot(row - 0.5 + 0.08 * k, col)[..., None] < 0.2
        light = np.where(disc, [0.9, 0.6, 0.3], [0.004, 0.006, 0.01])
        light[np.hypot(row, col) > 0.5] = 0
        codes = np.rint(65535 * SRGB().encode(light)).astype(np.float32) / 65535
        path = folder / f"show.{k + 1:04d}.png"
        write_frame(Frame(codes, path, COLOUR, 16, floating=False), path)
    return folder


def pictures(masters: Path, place: Path, recipe: Previewing) -> np.ndarray[Any, Any]:
    """Codes of the pictures that a worker writes of the last frame, 0..1."""
    show = find_show(str(masters / f"show.{COUNT:04d}.png"))
    done = Steps(recipe.work(lambda text: None)).all(
        Order(show, (place,), recipe, Writing(".png"), None)
    )
    assert "dark" in done.figures  # type: ignore[union-attr]
    return read_frame(place).pixels


def expected(masters: Path, way: str) -> np.ndarray[Any, Any]:
    """Light that is seen by a method, 1 = white."""
    scene = load_scene("dome_planetarium")
    master = read_master([masters / f"show.{COUNT:04d}.png"])
    posed = Stage(scene).pose(decoded(master, scene))
    return np.asarray(scene.projector.to_display(posed.seen(solved(posed, way).light))[0])


@pytest.mark.parametrize(
    ("brightness", "gain"),
    [(Brightness(), 1.0), (Brightness(stops=2), 4.0), (Brightness(display=3.5), 2.0)],
    ids=["exposed", "two stops", "as bright as there"],
)
def test_pictures_are_what_is_seen(
    masters: Path, tmp_path: Path, brightness: Brightness, gain: float
) -> None:
    """Dithered codes have the light's mean; 7 cd/m² is the theatre's white."""
    recipe = Previewing(SceneChoice("dome_planetarium"), brightness)
    codes = pictures(masters, tmp_path / "1.png", recipe)
    for part, way in zip(np.split(codes, 3, axis=1), WAYS, strict=True):
        light = fitted(expected(masters, way).astype(np.float32), *recipe.box)
        wanted = SRGB().encode(np.clip(gain * light, 0, 1))
        assert part.shape == wanted.shape
        assert abs(part - wanted).max() <= 1.51 / 255  # noise of a code, and rounding
        assert part.mean() == pytest.approx(wanted.mean(), abs=0.05 / 255)


def test_a_wipe_has_both_in_one_place(masters: Path, tmp_path: Path) -> None:
    choice = SceneChoice("dome_planetarium")
    beside = pictures(masters, tmp_path / "1.png", Previewing(choice, Brightness()))
    wiped = pictures(masters, tmp_path / "2.png", Previewing(choice, Brightness(), wipe=True))
    untouched, _, compensated = np.split(beside, 3, axis=1)
    for part, other in zip(np.split(wiped, 2, axis=1), (untouched, compensated), strict=True):
        assert part.mean() == pytest.approx(other.mean(), rel=0.02)  # of another size


def test_a_film_of_a_show(run: Run, masters: Path, tmp_path: Path) -> None:
    film = tmp_path / "preview.mp4"
    done = run(
        *("preview", masters / "show.####.png", "--scene", "dome_planetarium", "--out", film),
        *("--workers", 0, "--fps", 30, "--json"),
    )
    assert done.code == 0, done.err
    found = json.loads(done.out)
    assert sorted(path.name for path in tmp_path.iterdir()) == [".domesim", "preview.mp4"]
    with av.open(film) as container:
        stream = container.streams.video[0]
        assert stream.average_rate == Fraction(30)
        frames = [each.to_ndarray(format="rgb24") for each in container.decode(stream)]
    assert len(frames) == len(found["frames"]) == COUNT
    assert frames[0].shape == (SIZE[1], SIZE[0], 3)
    first, last = (each.astype(float) for each in (frames[0], frames[-1]))
    # The disc rises, and a line goes through the graphs
    assert abs(last - first)[: SIZE[1] // 2].max() > 100
    assert abs(last - first)[-330:-40].max() > 100
    for key in WAYS:
        black = [each["dark"][key] for each in found["frames"]]
        assert black[-1] > black[0] > 0
    dark = found["frames"][-1]["dark"]
    assert dark["master"] <= dark["subtractive"] <= dark["perceptual"] < dark["none"]


def test_a_pair_is_shown_by_its_left_eye(run: Run, masters: Path, tmp_path: Path) -> None:
    left, right = (tmp_path / f"{eye}.png" for eye in ("left", "right"))
    for number, place in ((1, left), (COUNT, right)):
        place.write_bytes((masters / f"show.{number:04d}.png").read_bytes())
    film = tmp_path / "pair.mp4"
    scene = ("--scene", "stereo_polarised_paper")
    done = run("preview", "--left", left, "--right", right, *scene, "--out", film, "--wipe")
    assert done.code == 0, done.err
    with av.open(film) as container:
        (frame,) = (each.to_ndarray(format="rgb24") for each in container.decode(video=0))
    # Where the left has its disc, and where its right one has
    middle = frame[:, SIZE[0] // 2].astype(float).mean(axis=-1)
    assert middle[:700].argmax() > 400
    assert middle[48:300].max() < 60


def test_pyav_is_missed_before_pictures_are_made(
    run: Run, masters: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    monkeypatch.setattr(previewing, "figures_of_all", lambda *_: pytest.fail("a picture is made"))
    film = tmp_path / "p.mp4"
    asked = ("preview", masters / "show.####.png", "--scene", "dome_planetarium", "--out", film)
    run(*asked).is_refused("p.mp4", "domesim[video]")
    assert not film.exists()


def test_what_cannot_be(run: Run, masters: Path, tmp_path: Path) -> None:
    asked = ("preview", masters / "show.####.png", "--scene", "dome_planetarium", "--out")
    film = tmp_path / "p.mp4"
    run(*asked, film, "--display", 9, "--exposure", 1).is_refused("--display", "--exposure")
    film.write_bytes(b"a film of somebody's")
    run(*asked, film).is_refused("p.mp4", "--overwrite")
    assert film.read_bytes() == b"a film of somebody's"
    with pytest.raises(InputError):
        Brightness(display=-1)


def test_a_pair_is_looked_at_first(tmp_path: Path, run: Run) -> None:
    """As `compensate` does: before any frame is done."""
    for number in range(2):
        for eye, light in (("l", 0.8), ("r", 0.2)):
            row = np.linspace(0, 1, 64)[None, :, None] + np.zeros((36, 1, 3))
            path = tmp_path / f"{eye}.{number}.png"
            codes = SRGB().encode(light * row).astype(np.float32)
            write_frame(Frame(codes, path, COLOUR, 16, floating=False), path)
    film, pair = tmp_path / "film.mp4", ("--left", tmp_path / "l.#.png", "--right")
    how = ("--scene", "stereo_spectral", "--workers", 0, "--out", film)
    asked = run("preview", *pair, tmp_path / "r.#.png", *how)
    asked.is_refused("left 4.00 times as bright as right", "--as-given")
    assert not film.exists()
    assert run("preview", *pair, tmp_path / "r.#.png", *how, "--as-given").code == 0


def test_a_line_that_hardly_changes_is_seen() -> None:
    """Apart from the frame of its graph."""
    values = [0.6 + 1e-5 * k for k in range(9)]
    picture, places = previewing._drawn([Panel("light", {"master": values})], range(9))
    rows, first, step = places[0]
    middle = picture[rows, round(first + 4 * step)].astype(int)
    line = np.flatnonzero((abs(middle - 0xC8) < 40).all(axis=-1))
    assert line.size
    assert 4 < line.mean() < 0.2 * len(middle)
