"""Direct and reflected light apart by shifted boards: by hand, in traced rooms, by the command."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from rooms import ROOMS

from domesim.errors import InputError
from domesim.frames import ColourTag, Frame, write_frame
from domesim.measure.dome.camera import domemaster_camera
from domesim.measure.dome.responses import responses_of
from domesim.measure.dome.separated import modelled, separated
from domesim.measure.patterns import Codes
from domesim.measure.patterns.dome import SHIFTED, SHIFTS, dome_patterns
from domesim.observation.spherical import bare_gain
from domesim.pathtrace.tabulate import tabulate
from domesim.room.dome import Dome
from domesim.room.theatre import Floor, Wall
from domesim.scene import load_dome
from testing.laboratory import Faults, photographed

SIZE = 96
LINEAR = Codes(16, floating=False, transfer="linear")
HEMISPHERE = Dome(3.0, np.pi / 2)
RECESSED = replace(
    ROOMS["recessed"],
    floor=Floor(-1.0, 3.0, (0.2, 0.5, 0.1)),
    wall=Wall(3.0, -1.0, 0.0, (0.3, 0.4, 0.1)),
)


@cache
def boards(dome: Dome, size: int = 192) -> tuple[tuple[str, ...], np.ndarray]:
    """Names and (pattern, row, col, primary) light of black and of the shifted boards."""
    wanted = [
        each
        for each in dome_patterns(dome, LINEAR, 4)
        if each.name == "black" or each.name.startswith(SHIFTED)
    ]
    light = np.stack([np.asarray(each.codes(size, size)[0], np.float64) for each in wanted])
    return tuple(each.name for each in wanted), light


@pytest.mark.parametrize("dome", [HEMISPHERE, Dome(3.0, np.radians(105), 0.3, 0.8)])
def test_every_place_is_well_inside_lit_and_dark_fields(dome):
    names, light = boards(dome, 256)
    shown, on = light[1:, ..., 0], dome.inside(256, 256)
    made = {each.name: each.parameters for each in dome_patterns(dome, LINEAR, 4)}
    shifts = [made[name]["shift"] for name in names[1:]]
    assert len(names) == 1 + SHIFTS
    assert shown[:, on].mean(1) == pytest.approx([0.5] * SHIFTS, abs=0.01)
    for k in (0, 1, 4, 5):  # one field further, each is the other's complement
        assert (shown[k] + shown[k + 2])[on] == pytest.approx(1)
    x, y, z = np.moveaxis(dome.directions(256, 256), -1, 0)
    ring = np.arccos(np.clip(z, -1, 1)) / dome.half_angle * 4
    sector = np.degrees(np.arctan2(y, x)) % 360 / 30
    for state in (0, 1):
        best = np.zeros(on.shape)
        for shift, one in zip(shifts, shown, strict=True):
            fields = sector + shift[0], ring + shift[1]
            even = (np.floor(fields[0]) + np.floor(fields[1])) % 2 == 0
            assert np.mean(even == one, where=on) > 0.999
            inside = [np.minimum(place % 1, 1 - place % 1) for place in fields]
            best = np.maximum(best, np.where(one == state, np.minimum(*inside), 0))
        assert best[on].min() >= 0.25 - 1e-9


@pytest.mark.parametrize("photographed_black", [True, False])
def test_light_is_taken_apart_as_it_was_put_together(photographed_black):
    """On a bare sphere reflected light is even, and a board's is half of white's."""
    theatre = replace(RECESSED, floor=None, wall=None)
    _, light = boards(HEMISPHERE)
    rho = np.array(theatre.albedo)
    reflected = np.array([bare_gain(each, HEMISPHERE) for each in rho])
    black = 0.01
    picture = (1 - black) * light + black
    areas = HEMISPHERE.screen_areas(*light.shape[1:3])
    flux = np.einsum("rc,krcp->kp", areas, picture) / areas.sum()
    on = HEMISPHERE.inside(*light.shape[1:3])[..., None]
    seen = np.where(on, picture + (flux * reflected)[:, None, None], 0)
    from domesim.measure.dome.photographs import Photographs  # noqa: PLC0415

    shots = Photographs(
        domemaster_camera(theatre), 0.3 * seen, np.arange(len(seen)), np.ones(len(seen))
    )
    responses = responses_of(theatre, light, shots, 0)
    board = np.arange(len(light)) > 0
    dark = ~board if photographed_black else np.zeros_like(board)
    found = separated(responses, board, dark, black)
    assert found.ratio == pytest.approx(np.broadcast_to(reflected, found.ratio.shape), rel=5e-3)
    share = (1 - black) if photographed_black else 1
    assert found.direct == pytest.approx(0.3 * share, rel=5e-3)
    assert len(found.ratio) > 500
    assert found.places.shape == (2, len(found.ratio))


@pytest.mark.parametrize(
    "theatre",
    [
        pytest.param(RECESSED, id="recessed"),
        pytest.param(ROOMS["leaning"], id="leaning", marks=pytest.mark.long),
    ],
)
def test_the_map_is_that_of_tabulation_in_traced_rooms(theatre):
    """Nayar's map and the tabulated room agree within 3 %; a wrong room does not."""
    names, light = boards(theatre.dome)
    camera = replace(domemaster_camera(theatre), position=(0.1, -0.2, -0.1))
    faults = Faults(0.01, vignetting=0.02, camera_m=(0.02, -0.01, 0.02), turn_deg=(0.2, 0.3, -0.2))
    shots = photographed(
        theatre, camera, light, faults, ambient=(0.002,) * 3, size=SIZE, walks=24, seed=5
    )
    responses = responses_of(theatre, light, shots, 0)
    board = np.array([each != "black" for each in names])
    found = separated(responses, board, ~board, 0.0)
    scene = replace(load_dome("dome_hemisphere"), theatre=theatre)
    stored = tabulate(theatre, error=2e-3, seed=1).transport
    model = modelled(replace(scene, transport=stored), found.places)
    off = model / found.ratio - 1
    assert np.abs(off.mean(0)).max() < 0.03
    assert np.sqrt(np.mean(off**2)) < 2 * np.sqrt(np.mean((found.error / found.ratio) ** 2)) < 0.2
    closed = modelled(replace(scene, transport=None), found.places)
    worst = int(np.argmax(np.abs(closed.mean(0) / found.mean - 1)))
    assert abs(closed.mean(0) / found.mean - 1)[worst] > 0.08


def test_errors_grow_with_noise():
    theatre = RECESSED
    names, light = boards(theatre.dome)
    board = np.array([each != "black" for each in names])
    errors = []
    for noise in (0.0, 0.05):
        shots = photographed(
            theatre, domemaster_camera(theatre), light, Faults(noise), size=SIZE, walks=8, seed=5
        )
        responses = responses_of(theatre, light, shots, 0)
        errors.append(separated(responses, board, ~board, 0.0).error.mean())
    assert errors[1] > 1.2 * errors[0] > 0


THEATRE = """\
name = "plan"
[dome]
radius_m = 4.0
[screen]
albedo = {albedo}
[projector]
white_cd_m2 = 8.0
[viewing]
adaptation_cd_m2 = 0.5
"""


@pytest.fixture(scope="module")
def survey(tmp_path_factory):
    """A survey of a bare dome of albedo 0.5 with all that it names."""
    folder = tmp_path_factory.mktemp("survey")
    (folder / "true.toml").write_text(THEATRE.format(albedo=0.5))
    scene = load_dome(folder / "true.toml")
    names, light = boards(scene.dome)
    camera = replace(domemaster_camera(scene.theatre), field=np.pi)
    shots = photographed(scene.theatre, camera, light, Faults(0.005), size=SIZE, walks=24, seed=2)
    text = 'theatre = "plan.toml"\n[camera]\nposition_m = [0, 0, 0]\nlook_at_m = [0, 0, 1]\n'
    text += "field_deg = 180.0\n"
    linear = ColourTag("linear", "BT.709", "the test")
    for name, pattern, shot in zip(names, light, shots.light, strict=True):
        for path, pixels in ((f"pattern_{name}.exr", pattern), (f"{name}.exr", shot)):
            file = folder / path
            frame = Frame(pixels.astype(np.float32), file, linear, 32, floating=True)
            write_frame(frame, file)
        text += f'[[photographs]]\nfile = "{name}.exr"\npattern = "pattern_{name}.exr"\n'
    (folder / "survey.toml").write_text(text)
    return folder


@pytest.mark.parametrize(("albedo", "verdict"), [(0.5, "within what"), (0.3, "off by more than")])
def test_the_command_checks_the_model(survey, run, albedo, verdict):
    (survey / "plan.toml").write_text(THEATRE.format(albedo=albedo))
    out = survey / "map.csv"
    code, told, _ = run("measure", "reflected", survey / "survey.toml", "--out", out, "--overwrite")
    assert code == 0
    assert verdict in told
    code, told, _ = run(
        "measure", "reflected", survey / "survey.toml", "--out", out, "--overwrite", "--json"
    )
    figures = json.loads(told)
    assert figures["ratio"] == pytest.approx([1 / 3] * 3, rel=0.02)
    model = bare_gain(albedo, load_dome(survey / "plan.toml").dome)
    assert figures["model"] == pytest.approx([model] * 3, rel=1e-3)
    rows = list(csv.DictReader(out.read_text().splitlines()))
    assert len(rows) == figures["places"] > 500
    assert np.mean([float(row["ratio_G"]) for row in rows]) == pytest.approx(figures["ratio"][1])
    assert max(float(row["angle_deg"]) for row in rows) < 90
    assert out.with_suffix(".png").read_bytes()[:4] == b"\x89PNG"


def test_albedos_do_without_the_boards(survey, run):
    """Their fields are too fine; what is left of this survey is a black picture."""
    (survey / "plan.toml").write_text(THEATRE.format(albedo=0.5))
    code, _, err = run("measure", "dome", survey / "survey.toml", "--out", survey / "no.toml")
    assert code == 2
    assert "no place on the screen was photographed lit and unlit" in err


def test_a_survey_without_the_boards_is_refused(survey, run):
    (survey / "plan.toml").write_text(THEATRE.format(albedo=0.5))
    text = (survey / "survey.toml").read_text()
    cut = text[: text.rindex("[[photographs]]")]
    (survey / "short.toml").write_text(cut)
    code, _, err = run("measure", "reflected", survey / "short.toml", "--out", survey / "x.csv")
    assert code == 2
    assert "wanted photographs of all 8 patterns shifted-12x4-1 to shifted-12x4-8, got 7" in err
    assert not (survey / "x.csv").exists()


def test_one_board_alone_is_refused():
    theatre = replace(RECESSED, floor=None, wall=None)
    _, light = boards(HEMISPHERE)
    shots = photographed(theatre, domemaster_camera(theatre), light, Faults(), size=SIZE, walks=2)
    responses = responses_of(theatre, light, shots, 0)
    one, none = np.arange(len(light)) == 1, np.zeros(len(light), bool)
    with pytest.raises(InputError, match="no place of the screen is clear"):
        separated(responses, one, none, 0.0)
