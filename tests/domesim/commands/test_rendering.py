"""``domesim render`` and ``domesim tabulate``: layers in cd/m², files that others read, Ctrl-C."""

from __future__ import annotations

import io
import json
import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from command_line import Outcome, exit_code, outcome
from image_files import store
from numpy.typing import NDArray

from domesim.frames import read_frame
from domesim.inspection.magnitudes import faintest_star
from domesim.light.transfer import SRGB
from domesim.observation import radiosity as radiosity_module
from domesim.observation.transport import load_transport
from domesim.pathtrace import tabulate as tabulate_module
from domesim.pathtrace import tracer as tracer_module
from domesim.room.dome import Dome
from domesim.scene import load_scene

SIZE = 32
WHITE = 10.0
HALL = """
name = "a hall"
dome = { radius_m = 5.0 }
screen = { albedo = [0.5, 0.4, 0.3] }
projector = { white_cd_m2 = 10.0 }
floor = { height_m = -1.5, albedo = 0.3 }
wall = { albedo = 0.2 }
viewing = { adaptation_cd_m2 = 1.4 }
"""
FURNISHED = """
name = "a furnished room"
dome = { radius_m = 5.0, tilt_deg = 10.0 }
screen = { albedo = 0.5 }
projector = { white_cd_m2 = 10.0, black_cd_m2 = 0.02 }
floor = { height_m = -1.5, albedo = 0.3 }
wall = { albedo = 0.2 }
seating = { rows = 2, seats_per_row = 3, first_row_m = 1.0, albedo = 0.2, occupied = 0.5 }
viewing = { adaptation_cd_m2 = 1.4 }
[viewpoints]
aisle = { position_m = [0, -1.5, 1], look_at_m = [0, 4, -0.5], field_deg = 90 }
[[lamps]]
name = "exit sign"
position_m = [0.0, 4.7, -1.0]
normal = [0.0, -1.0, 0.3]
width_m = 0.6
height_m = 0.4
luminance_cd_m2 = [20.0, 40.0, 10.0]
"""


def domesim(*arguments: object) -> Outcome:
    """The command in this process, where there is no fixture of a test's."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = exit_code(*arguments)
    return outcome(code, out.getvalue(), err.getvalue())


@dataclass(frozen=True)
class Layers:
    """A layered EXR, as OpenImageIO reads it: (row, col, primary) by name, and its header."""

    layers: Mapping[str, NDArray[np.float64]]
    header: Mapping[str, Any]

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        return self.layers[name]


def layers_of(path: Path) -> Layers:
    source = oiio.ImageInput.open(str(path))
    spec, pixels = source.spec(), source.read_image(oiio.FLOAT)
    source.close()
    names = list(spec.channelnames)
    layers = {}
    for layer in {name.rpartition(".")[0] for name in names}:
        triple = [names.index(f"{layer}.{part}" if layer else part) for part in "RGB"]
        layers[layer] = pixels[..., triple].astype(np.float64)
    assert len(names) == 3 * len(layers)
    header = {entry.name: entry.value for entry in spec.extra_attribs}
    return Layers(layers, header)


def uneven(size: int = SIZE) -> NDArray[np.float32]:
    """A picture whose quarters differ, and its primaries."""
    picture = np.full((size, size, 3), 0.1, np.float32)
    picture[: size // 2, : size // 2] = (0.9, 0.2, 0.0)
    picture[size // 2 :, size // 2 :] = (0.0, 0.6, 0.8)
    return picture


def over_screen(
    picture: NDArray[Any], variance: NDArray[Any], dome: Dome
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(primary,) means over the screen's area, and their standard errors."""
    share = dome.screen_areas(*picture.shape[:2])
    share = share / share.sum()
    mean = np.einsum("ij,ijp->p", share, picture)
    return mean, np.sqrt(np.einsum("ij,ijp->p", share**2, variance))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Scenes and masters."""
    place = tmp_path_factory.mktemp("rendering")
    for name, text in {"hall": HALL, "furnished": FURNISHED}.items():
        (place / f"{name}.toml").write_text(text)
    store(place / "white.exr", np.ones((SIZE, SIZE, 3)).astype(np.float32))
    store(place / "grey.exr", np.full((SIZE, SIZE, 3), 0.25).astype(np.float32))
    store(place / "uneven.exr", uneven())
    return place


# The domemaster.


@pytest.fixture(scope="module")
def white(folder: Path) -> tuple[Layers, dict[str, Any]]:
    """A white master on the bare hemisphere: the file, and the figures."""
    out = folder / "white" / "seen.exr"
    figures = domesim(
        "render", "dome_hemisphere", "--master", folder / "white.exr", "--out", out,
        "--error", 0.02, "--seed", 5, "--per-bounce", "--json",
    ).figures()  # fmt: skip
    return layers_of(out), figures


def test_the_layers_are_named(white: tuple[Layers, dict[str, Any]]) -> None:
    found, figures = white
    bounces = {f"bounce{k}" for k in range(1, figures["bounces"] + 1)}
    assert set(found.layers) == {"", "direct", "indirect", "variance", *bounces}
    assert {layer.shape for layer in found.layers.values()} == {(SIZE, SIZE, 3)}


def test_indirect_light_of_a_white_master_is_the_closed_form(
    white: tuple[Layers, dict[str, Any]],
) -> None:
    """Every point of a hemisphere sees rho / (2 - rho) of the direct light again."""
    found, figures = white
    dome = load_scene("dome_hemisphere").dome
    screen, truth = dome.inside(SIZE, SIZE), WHITE * 0.5 / 1.5
    mean, error = over_screen(found["indirect"], found["variance"], dome)
    assert np.all(np.abs(mean - truth) < 4 * error), (mean, error)
    assert np.all(error < 2e-3 * truth)
    # Grey light on a grey screen: primaries are one and the same estimate.
    scores = (found["indirect"][screen] - truth) / np.sqrt(found["variance"][screen])
    assert np.sqrt(np.mean(scores[:, 0] ** 2)) == pytest.approx(1, abs=0.1)
    assert figures["mean_cd_m2"]["indirect"] == pytest.approx(float(mean[0]), rel=1e-5)
    assert figures["mean_cd_m2"]["direct"] == pytest.approx(WHITE, rel=1e-6)


def test_the_darker_half_has_its_faintest_star(white: tuple[Layers, dict[str, Any]]) -> None:
    found, figures = white
    screen = load_scene("dome_hemisphere").dome.inside(SIZE, SIZE)
    seen = found[""][screen, 0]  # grey
    black = seen[seen <= np.median(seen)].mean()
    sky = figures["darker_half"]
    assert sky["cd_m2"] == pytest.approx(black, rel=1e-3)
    assert sky["mag_arcsec2"] == pytest.approx(12.58 - 2.5 * np.log10(sky["cd_m2"]))
    assert sky["faintest_star"] == faintest_star(sky["cd_m2"], 0.0)._asdict()


def test_the_header_says_where_it_is_from(white: tuple[Layers, dict[str, Any]]) -> None:
    found, figures = white
    header = found.header
    scene = load_scene("dome_hemisphere")
    assert header["domesim:scene"] == figures["scene"] == "dome_hemisphere"
    assert header["domesim:digest"] == scene.digest
    assert header["domesim:seed"] == figures["seed"] == 5
    assert header["domesim:samples"] == figures["samples"] > 32
    assert header["domesim:status"] == figures["status"]
    assert header["domesim:white_cd_m2"] == WHITE
    assert "cd/m2" in header["domesim:units"]
    for program in ("domesim", "mitsuba", "drjit", "Python"):
        assert f"{program} " in header["domesim:versions"]
    assert header["chromaticities"][:2] == pytest.approx((0.64, 0.33))
    assert header["chromaticities"][6:] == pytest.approx((0.3127, 0.3290), abs=1e-4)


def test_a_preview_lies_beside_it(folder: Path) -> None:
    out = folder / "preview" / "seen.exr"
    outcome = domesim("render", "dome_hemisphere", "--master", folder / "grey.exr", "--out", out)
    assert (outcome.code, outcome.err) == (0, "")
    assert sorted(path.name for path in out.parent.glob("[!.]*")) == ["seen.exr", "seen.png"]
    for path in (out, out.with_suffix(".png")):
        assert f"  -> {path}" in outcome.out.splitlines()
    assert "mag/arcsec²; faintest star, a point: " in outcome.out
    preview = read_frame(out.with_suffix(".png"))
    assert (preview.pixels.shape, preview.bits) == ((SIZE, SIZE, 3), 8)
    screen = load_scene("dome_hemisphere").dome.inside(SIZE, SIZE)
    seen = 0.25 * 4 / 3
    assert preview.pixels[screen].mean() == pytest.approx(1.055 * seen ** (1 / 2.4) - 0.055, 0.01)
    assert np.all(preview.pixels[~screen] == 0)


def test_large_numbers_fit_into_the_header(folder: Path) -> None:
    """More than 2^31 segments are an hour's work; a seed is soon as long."""
    out, seed = folder / "large" / "seen.exr", 3 << 70
    arguments = ("--master", folder / "white.exr", "--samples", 2, "--seed", seed, "--json")
    figures = domesim("render", "dome_hemisphere", "--out", out, *arguments).figures()
    assert figures["seed"] == int(layers_of(out).header["domesim:seed"]) == seed


def test_codes_of_a_master_become_light(folder: Path) -> None:
    codes = store(folder / "codes.png", np.full((SIZE, SIZE, 3), 188, np.uint8))
    out = folder / "codes" / "seen.exr"
    domesim("render", "dome_hemisphere", "--master", codes, "--out", out, "--samples", 2)
    screen = load_scene("dome_hemisphere").dome.inside(SIZE, SIZE)
    light = float(SRGB().decode(188 / 255))
    np.testing.assert_allclose(layers_of(out)["direct"][screen], WHITE * light, rtol=1e-6)


def test_the_bundled_master_is_resized(folder: Path) -> None:
    out = folder / "night" / "seen.exr"
    arguments = ("--size", 48, "--samples", 4, "--json")
    domesim("render", "dome_hemisphere", "--out", out, *arguments).figures()
    found = layers_of(out)
    assert found["direct"].shape == (48, 48, 3)
    assert 0.1 < found["direct"].max() <= WHITE


# From a seat, and from outside.


@pytest.fixture(scope="module")
def seat(folder: Path) -> Layers:
    out = folder / "seat" / "seen.exr"
    domesim(
        "render", folder / "furnished.toml", "--view", "seat:aisle", "--master",
        folder / "uneven.exr", "--out", out, "--size", 48, "--per-bounce", "--json",
    ).figures()  # fmt: skip
    return layers_of(out)


def test_a_seat_sees_the_picture_the_room_and_the_lamps(seat: Layers) -> None:
    total = seat["direct"] + seat["indirect"] + seat["ambient"]
    np.testing.assert_allclose(seat[""], total, rtol=1e-5, atol=1e-6)
    bounces = sum(layer for name, layer in seat.layers.items() if name.startswith("bounce"))
    np.testing.assert_allclose(bounces, seat["indirect"], rtol=1e-4, atol=1e-4)
    # Above is the screen, below are the floor and seats.
    assert np.all(seat["direct"][0].max(-1) > 0.9)
    assert np.all(seat["direct"][-1] == 0)
    assert np.all(seat["indirect"][[0, -1]] > 0)
    # The lamp is greener than the picture, and not reddish.
    red, green, blue = seat["ambient"].mean((0, 1))
    assert 1.8 < green / red < 2.2
    assert 1.8 < red / blue < 2.2


def test_the_picture_is_not_mirrored_from_a_seat(seat: Layers) -> None:
    """A domemaster's front is below and its right is right: blue and green is front right."""
    top = seat["direct"][:4]
    left, right = top[:, :20].mean((0, 1)), top[:, 28:].mean((0, 1))
    assert right[2] > 5 * right[0]
    assert left[0] == pytest.approx(left[2], rel=1e-3)  # front left is grey


@pytest.mark.parametrize("view", ["seat:balcony", "balcony", "seat:"])
def test_an_unknown_seat_is_told_the_known_ones(folder: Path, view: str) -> None:
    out = folder / "unknown" / "seen.exr"
    outcome = domesim("render", folder / "furnished.toml", "--view", view, "--out", out)
    outcome.is_refused(f"'{view}'", "domemaster", "cutaway", "seat:back", "seat:centre", "...")
    assert list(out.parent.iterdir()) == []


def test_the_theatre_from_outside(folder: Path) -> None:
    out = folder / "outside" / "hall.png"
    figures = domesim(
        "render", folder / "furnished.toml", "--view", "cutaway", "--size", 36, "--out", out,
        "--master", folder / "uneven.exr", "--json",
    ).figures()  # fmt: skip
    assert figures == {
        "scene": "a furnished room", "view": "cutaway", "output": str(out), "failed": [],
    }  # fmt: skip
    assert list(out.parent.glob("[!.]*")) == [out]
    pixels = read_frame(out).pixels
    assert pixels.shape == (24, 36, 3)
    assert pixels.std() > 0.05


# Lamps and black.


def test_what_is_there_without_a_picture_is_counted(folder: Path) -> None:
    out = folder / "ambient" / "seen.exr"
    domesim(
        "render", folder / "furnished.toml", "--master", folder / "white.exr", "--out", out,
        "--samples", 64, "--json",
    ).figures()  # fmt: skip
    found = layers_of(out)
    screen = load_scene(folder / "furnished.toml").dome.inside(SIZE, SIZE)
    parts = found["direct"] + found["indirect"] + found["ambient"]
    np.testing.assert_allclose(found[""][screen], parts[screen] + 0.02, rtol=1e-5)
    assert found["ambient"][screen].min() > 0


# Tables of the whole transport.


@pytest.fixture(scope="module")
def quick_radiosity() -> Iterator[None]:
    """The second opinion at a resolution that does for a test."""
    with pytest.MonkeyPatch.context() as patch:
        coarse = partial(radiosity_module.radiosity, resolution=6, nodes=41)
        patch.setattr(radiosity_module, "radiosity", coarse)
        yield


@pytest.fixture(scope="module")
def hall(folder: Path, quick_radiosity: None) -> tuple[Path, dict[str, Any]]:
    """The transport of dome, floor and wall, and the figures."""
    out = folder / "tables" / "hall.npz"
    arguments = ("--walks", 1e6, "--degree", 2, "--seed", 3, "--json")
    return out, domesim("tabulate", folder / "hall.toml", "--out", out, *arguments).figures()


@pytest.fixture(scope="module")
def room(folder: Path) -> tuple[Path, Path, Outcome]:
    """A scene with seats but no lamps, its transport, and what was said about it."""
    scene, out = folder / "room.toml", folder / "tables" / "room.npz"
    scene.write_text(FURNISHED.partition("[[lamps]]")[0])
    outcome = domesim("tabulate", scene, "--out", out, "--walks", 1e6, "--degree", 2)
    assert (outcome.code, outcome.err) == (0, "")
    return scene, out, outcome


def test_a_table_is_read_as_it_was_written(folder: Path, hall: tuple[Path, dict[str, Any]]) -> None:
    path, figures = hall
    assert list(path.parent.glob("hall*")) == [path]
    transport, scene = load_transport(path), load_scene(folder / "hall.toml")
    assert transport.dome == scene.dome
    assert transport.provenance["scene"] == figures["scene"] == "a hall"
    assert transport.provenance["digest"] == scene.digest
    assert transport.provenance["seed"] == 3
    assert transport.provenance["walks"] == figures["walks"] >= 1e6
    assert transport.rank == figures["rank"] == 6
    assert figures["mean_gain"] == pytest.approx(transport.mean_gain().tolist())
    assert figures["relative_error"] == pytest.approx(transport.relative_error())
    assert 0 < figures["relative_error"] < 2e-3
    assert "most samples" in figures["status"]
    assert figures["closed_form_gain"] == pytest.approx([1 / 3, 1 / 4, 0.3 / 1.7])
    assert figures["output"] == str(path)


def test_radiosity_is_of_the_same_opinion(hall: tuple[Path, dict[str, Any]]) -> None:
    _, figures = hall
    opinion = figures["second_opinion"]
    gain = np.array(figures["mean_gain"])
    # The room matters, and both see it.
    assert np.all(gain > 1.2 * np.array(figures["closed_form_gain"]))
    apart = np.abs(np.array(opinion["mean_gain"]) / gain - 1).max()
    assert opinion["apart"] == pytest.approx(apart, rel=1e-6)
    assert apart < 4 * figures["relative_error"] + 5e-4  # what six rings of patches cost


def test_what_radiosity_cannot_know_is_said(room: tuple[Path, Path, Outcome]) -> None:
    scene, out, outcome = room
    (opinion,) = (line for line in outcome.out.splitlines() if "opinion" in line)
    assert opinion.startswith("No second opinion: ")
    assert "solids (seats" in opinion
    assert "tabulate" not in opinion  # that is what was done
    assert f"Use it: domesim compensate MASTER --scene {scene} --transport {out}" in outcome.out


@pytest.mark.usefixtures("quick_radiosity")
def test_the_seed_of_a_table_decides(folder: Path, hall: tuple[Path, dict[str, Any]]) -> None:
    cores = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        out = folder / "tables" / f"{name}.npz"
        arguments = ("--walks", 1, "--degree", 1, "--seed", seed, "--no-check", "--json")
        figures = domesim("tabulate", folder / "hall.toml", "--out", out, *arguments).figures()
        assert "second_opinion" not in figures
        cores.append(load_transport(out).core)
    np.testing.assert_array_equal(cores[0], cores[1])
    assert np.all(cores[0] != cores[2])


APPROXIMATE = "approximate: the closed form knows the bare screen only"


def test_observe_uses_the_table(folder: Path, room: tuple[Path, Path, Outcome]) -> None:
    scene, table, _ = room
    arguments = ("observe", folder / "white.exr", "--scene", scene, "--out", folder / "observed")
    without, told = domesim(*arguments, "--json").figures(), domesim(*arguments)
    assert APPROXIMATE in without["approximation"]
    assert APPROXIMATE in told.out
    for reason in ("the floor reflects", "the wall reflects", "things stand in the room (seats"):
        assert reason in load_scene(scene).facts()["Left out"]
    arguments = (*arguments, "--transport", table)
    figures, told = domesim(*arguments, "--json").figures(), domesim(*arguments)
    assert (told.code, told.err) == (0, "")
    assert figures["approximation"] is None
    assert "approximate" not in told.out
    gain = float(load_transport(table).mean_gain()[0])
    (frame,), (bare,) = figures["frames"], without["frames"]
    assert frame["pollution_cd_m2"] == pytest.approx(WHITE * gain + 0.02, rel=2e-3)
    assert bare["pollution_cd_m2"] == pytest.approx(WHITE / 3 + 0.02, rel=1e-3)
    assert frame["pollution_cd_m2"] > 1.05 * bare["pollution_cd_m2"]


def test_compensate_uses_the_table(folder: Path, room: tuple[Path, Path, Outcome]) -> None:
    scene, table, _ = room
    written = {}
    for name, options in {"without": (), "with": ("--transport", table)}.items():
        out = folder / f"compensated {name}"
        outcome = domesim(
            "compensate", folder / "uneven.exr", "--scene", scene, "--out", out, *options
        )
        assert (outcome.code, outcome.err) == (0, "")
        assert (APPROXIMATE in outcome.out) == (name == "without")
        written[name] = read_frame(out / "uneven.exr").pixels
    # The room's light is more, so more is taken away.
    assert written["with"].mean() < written["without"].mean() - 1e-3


# Ctrl-C.


@pytest.fixture
def press_ctrl_c(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Callable[[], int]]:
    """Press it as a launch starts: the one with that number, so many times."""

    def press(at: int, times: int = 1) -> Callable[[], int]:
        real, started = tracer_module.launch_seed, 0

        def launch_seed(*parts: int) -> int:
            nonlocal started
            started += 1
            if started == at:
                for _ in range(times):
                    signal.raise_signal(signal.SIGINT)
            return real(*parts)

        for module in (tracer_module, tabulate_module):
            monkeypatch.setattr(module, "launch_seed", launch_seed)
        return lambda: started

    return press


INTERRUPTED = "Interrupted: this is what there was. Run it again for more."
COMPLAINT = "domesim: interrupted; what was written is complete\n"
VIEWS = ("domemaster", "seat:centre")


@pytest.mark.parametrize("view", VIEWS)
def test_an_interrupted_picture_is_written(
    folder: Path, press_ctrl_c: Callable[..., Callable[[], int]], view: str
) -> None:
    """With the least of the lamps' light, which would take as long again."""
    out = folder / "interrupted" / f"{view[:4]}.exr"
    before = signal.getsignal(signal.SIGINT)
    launches = press_ctrl_c(at=1)
    outcome = domesim(
        "render", folder / "furnished.toml", "--master", folder / "white.exr", "--out", out,
        "--error", 1e-4, "--samples", 400, "--view", view, "--size", SIZE, "--json",
    )  # fmt: skip
    assert (outcome.code, outcome.err) == (130, COMPLAINT)
    figures, found = json.loads(outcome.out), layers_of(out)
    assert figures["status"] == found.header["domesim:status"] == INTERRUPTED
    assert figures["samples"] == 32
    assert launches() == 2
    assert found["indirect"].max() > 0
    assert found["ambient"].max() > 0
    assert out.with_suffix(".png").is_file()
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.parametrize("view", VIEWS)
def test_interrupted_lamps_are_told(
    folder: Path, press_ctrl_c: Callable[..., Callable[[], int]], view: str
) -> None:
    out = folder / "interrupted" / f"{view[:4]} lamps.exr"
    press_ctrl_c(at=3)
    outcome = domesim(
        "render", folder / "furnished.toml", "--master", folder / "white.exr", "--out", out,
        "--error", 1e-6, "--samples", 64, "--view", view, "--size", SIZE, "--json",
    )  # fmt: skip
    assert outcome.code == 130
    assert json.loads(outcome.out)["status"] == INTERRUPTED


def test_an_interrupted_table_is_written(
    folder: Path, press_ctrl_c: Callable[..., Callable[[], int]]
) -> None:
    """Without a second opinion, which takes a while."""
    out = folder / "interrupted" / "hall.npz"
    launches = press_ctrl_c(at=2)
    outcome = domesim(
        "tabulate", folder / "hall.toml", "--degree", 2, "--error", 1e-9, "--out", out, "--json"
    )
    assert (outcome.code, outcome.err) == (130, COMPLAINT)
    figures, stored = json.loads(outcome.out), load_transport(out)
    assert figures["status"] == INTERRUPTED
    assert "second_opinion" not in figures
    assert stored.provenance["status"] == "INTERRUPTED"
    assert stored.provenance["walks"] == figures["walks"]
    assert launches() == 2
    assert stored.mean_gain() == pytest.approx([0.431, 0.317, 0.2205], rel=0.01)


@pytest.mark.parametrize("command", ["render", "tabulate"])
def test_a_second_ctrl_c_ends_everything(
    folder: Path, press_ctrl_c: Callable[..., Callable[[], int]], command: str
) -> None:
    out = folder / "ended" / f"seen.{'exr' if command == 'render' else 'npz'}"
    press_ctrl_c(at=1, times=2)
    outcome = domesim(command, folder / "hall.toml", "--out", out, "--quiet")
    assert (outcome.code, outcome.err) == (130, COMPLAINT)
    assert list(out.parent.iterdir()) == []
