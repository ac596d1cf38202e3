"""Readings on the command line: figures, and scenes that work as the measured rig does."""

from __future__ import annotations

import json
import shutil
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from rigs import BLACK, LEFT, NOISE, TO_LEFT, TO_RIGHT, Rig, masters, refused

from domesim.errors import InputError
from domesim.frames import read_frame
from domesim.light.transfer import SRGB, Linear
from domesim.observation.projector import CINEMA, MEASURED, PRIMARIES, Projector, relative_primaries
from domesim.readings.meter import read_readings
from domesim.readings.pair import measured_pair
from domesim.scene import load_stereo

RIG = Rig(noise=NOISE, repeats=3, ramps=False)
LEAKS = (TO_LEFT, TO_RIGHT)


@pytest.fixture
def rig(tmp_path):
    path = tmp_path / "readings" / "rig.csv"
    path.parent.mkdir()
    path.write_text(RIG.csv(seed=5))
    return path


def written(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


# From readings to a picture that the rig shows without ghosts.


def shown(scene, files):
    """(view, row, col, primary) common light of files."""
    pixels = np.stack([read_frame(file).pixels for file in files]).astype(np.float64)
    return scene.projector.decode(pixels, Linear(), "BT.709")


def residual(pair, frames, wanted):
    """What the true rig shows beyond the wanted picture and its black, and what causes it.

    In its own RGB:

    (view, row, col, primary) error, and (view, row, col, primary) light of the other projector.
    """
    own = np.stack([light @ m.T for light, m in zip(frames, pair.gamut.matrices, strict=True)])
    aim = np.stack([light @ m.T for light, m in zip(wanted, pair.gamut.matrices, strict=True)])
    ghosts = [own[1 - v] @ LEAKS[v].T for v in range(2)]
    seen = np.stack([own[v] + ghosts[v] for v in range(2)])
    return seen - aim, own[::-1]


def test_without_noise_nothing_is_left(run, rig, tmp_path):
    rig.write_text(Rig(ramps=False).csv())
    assert run("measure", "crosstalk", rig, "--out", tmp_path / "s.toml")[0] == 0
    left, right = masters(tmp_path)
    shows = ("--left", left, "--right", right, "--scene", tmp_path / "s.toml")
    assert run("compensate", *shows, "--out", tmp_path / "out")[0] == 0
    scene, pair = load_stereo(tmp_path / "s.toml"), measured_pair(read_readings(rig))
    wanted = shown(scene, (left, right))
    frames = shown(scene, (tmp_path / "out" / "l.exr", tmp_path / "out" / "r.exr"))
    assert np.abs(residual(pair, frames, wanted)[0]).max() < 3e-6
    assert np.abs(residual(pair, wanted, wanted)[0]).max() > 1e-2


def test_the_crosstalk_that_is_printed_is_the_scenes(run, rig, tmp_path):
    """Whoever copies it into a scene by hand loses nothing."""
    rig.write_text(Rig(ramps=False).csv())
    _, out, _ = run("measure", "crosstalk", rig, "--out", tmp_path / "s.toml")
    lines = [line.partition("as scenes have it: ")[2] for line in out.splitlines()]
    printed = tomllib.loads("\n".join(line for line in lines if line))
    (seat,) = load_stereo(tmp_path / "s.toml").seats.values()
    for matrix, eye in zip(seat.matrices, ("left", "right"), strict=True):
        assert np.abs(np.array(printed[f"to_{eye}"]) - matrix).max() < 6e-6


# The scene file.


def test_the_scene_says_where_each_figure_is_from(run, rig, tmp_path):
    code, out, _ = run("measure", "crosstalk", rig, "--out", tmp_path / "s.toml", "--height", "2")
    assert code == 0
    for words in ("system 2.0", "common gamut", "Assumed, as --width, --distance"):
        assert words in out
    content = tomllib.loads((tmp_path / "s.toml").read_text())
    assert content["crosstalk"] == {"readings": "readings/rig.csv"}
    assert content["screen"] == {"width_m": 2.5, "height_m": 2.0}
    assert "assumed" in content["sources"]["screen"]
    assert content["sources"]["screen"].endswith(": width")
    scene, pair = load_stereo(tmp_path / "s.toml"), measured_pair(read_readings(rig))
    assert scene.projector.primaries == MEASURED
    assert scene.projector.white == pytest.approx(pair.gamut.white[1])
    assert scene.projector.to_xyz * scene.projector.white == pytest.approx(pair.gamut.primaries)
    assert scene.seats["sweet spot"].matrices == pytest.approx(pair.common_matrices)
    seen = [crosstalk.black[1] for crosstalk in pair.crosstalk]
    assert scene.projector.black == pytest.approx(np.mean(seen))
    assert scene.ambient @ scene.projector.luminance_weights == pytest.approx(seen)
    assert "measured: readings/rig.csv" in scene.facts()["Crosstalk"]


def test_readings_may_move_along_with_the_scene(run, rig, tmp_path):
    (tmp_path / "a b").mkdir()
    assert run("measure", "crosstalk", rig, "--out", tmp_path / "a b" / "s.toml")[0] == 0
    moved = tmp_path / "moved"
    moved.mkdir()
    shutil.move(tmp_path / "a b", moved)
    shutil.move(rig.parent, moved)
    load_stereo(moved / "a b" / "s.toml")
    refused(
        run("measure", "crosstalk", rig, "--out", tmp_path / "s.toml"), "rig.csv", "check the path"
    )


@pytest.mark.parametrize(
    ("key", "value", "word"),
    [
        ("white_cd_m2", "60", "white_cd_m2: must be that of the readings"),
        ("black_cd_m2", "0.5", "black_cd_m2: must be that of the readings"),
        ("primaries", '"BT.709"', "leave primaries out"),
    ],
)
def test_figures_that_contradict_the_readings(run, rig, tmp_path, key, value, word):
    run("measure", "crosstalk", rig, "--out", tmp_path / "s.toml")
    text = (tmp_path / "s.toml").read_text()
    changed = text.replace('primaries = "measured"', f"{key} = {value}")
    assert changed != text
    (tmp_path / "s.toml").write_text(changed)
    with pytest.raises(InputError, match=word):
        load_stereo(tmp_path / "s.toml")


def test_figures_that_agree_may_stand(run, rig, tmp_path):
    run("measure", "crosstalk", rig, "--out", tmp_path / "s.toml")
    scene = load_stereo(tmp_path / "s.toml")
    text = (tmp_path / "s.toml").read_text()
    stated = f"white_cd_m2 = {scene.projector.white:.3g}\nblack_cd_m2 = {scene.projector.black:.3g}"
    (tmp_path / "s.toml").write_text(text.replace('primaries = "measured"', stated))
    assert load_stereo(tmp_path / "s.toml").projector == scene.projector


def test_seats_ambient_light_and_subtracted_black(run, rig, tmp_path):
    lines = [HEADER]
    for projector, through, channel, level, *xyz in Rig(ramps=False).rows():
        if channel != "K":
            net = ",".join(f"{value:.9f}" for value in np.array(xyz) - BLACK[through])
            lines.append(f"{projector},{through},{channel},{level},{net}")
    rig.write_text("\n".join(lines))
    arguments = ("measure", "crosstalk", rig, "--out", tmp_path / "s.toml")
    refused(run(*arguments), "no reading of K")
    assert run(*arguments, "--black", "subtracted")[::2] == (0, "")
    text = (tmp_path / "s.toml").read_text()
    assert 'black = "subtracted"' in text
    seats = '[[seats]]\nname = "side"\nfactor = 2.0\n[ambient]\nluminance_cd_m2 = 0.2\n'
    more = text.replace('"measured"', '"measured"\nblack_cd_m2 = 0.1').replace(
        "[viewing]", f"{seats}[viewing]"
    )
    (tmp_path / "s.toml").write_text(more)
    scene = load_stereo(tmp_path / "s.toml")
    assert scene.projector.black == 0.1
    assert scene.ambient == pytest.approx(0.3)
    pair = measured_pair(read_readings(rig, black="subtracted"))
    observed = scene.observation(2, 3)
    assert (observed.share == 2).all()
    assert observed.matrices == pytest.approx(pair.common_matrices)


# Figures for programs.


def test_json_says_all(run, rig, tmp_path):
    rig.write_text(replace(RIG, ramps=True).csv(seed=5))
    code, out, _ = run("measure", "crosstalk", rig, "--out", tmp_path / "s.toml", "--json")
    assert code == 0
    figures, pair = json.loads(out), measured_pair(read_readings(rig))
    assert figures["output"] == str(tmp_path / "s.toml")
    for eye, crosstalk in zip(("left", "right"), pair.crosstalk, strict=True):
        told = figures["eyes"][eye]
        assert np.array(told["matrix"]) == pytest.approx(crosstalk.matrix)
        assert np.array(told["standard_error"]) == pytest.approx(crosstalk.error)
        assert told["system_crosstalk"] == pytest.approx(crosstalk.system)
        assert told["system_crosstalk_error"] == pytest.approx(crosstalk.system_error)
        assert told["viewer_crosstalk_white_on_half"] == pytest.approx(
            2 * crosstalk.system, rel=0.1
        )
        assert told["response"]["gamma"] == pytest.approx(2.2, abs=0.02)
        assert len(told["projector"]["additivity"]) == 3
    gamut = figures["common_gamut"]
    assert np.array(gamut["matrices"]) == pytest.approx(pair.gamut.matrices)
    assert gamut["light_lost"] == pytest.approx(pair.gamut.lost)
    assert np.array(gamut["crosstalk"]) == pytest.approx(pair.common_matrices)


# Grey to grey.

CODES = (0, 0.25, 0.5, 0.75, 1)
WHITES, BLACKS, SLOPES = {"left": 40.0, "right": 36.0}, {"left": 0.1, "right": 0.2}, (0.02, 0.03)


def grey_readings(path, eyes=("left", "right"), slopes=SLOPES):
    """A panel whose leak is a share of the step from the own to the other picture's light."""
    lines = ["filter,own_level,other_level,Y"]
    for eye, slope in zip(eyes, slopes, strict=False):
        for own in CODES:
            for other in CODES:
                light = own**2.2 + slope * other**2.2 * (1 - 0.5 * own**2.2)
                lines.append(f"{eye},{own},{other},{BLACKS[eye] + WHITES[eye] * light:.9f}")
    path.write_text("\n".join(lines))
    return path


def test_grey_to_grey_becomes_a_scene(run, tmp_path):
    readings, scene_file = grey_readings(tmp_path / "grey.csv"), tmp_path / "panel.toml"
    arguments = ("measure", "grey-to-grey", readings, "--out", scene_file, "--width", "1.2")
    code, out, err = run(*arguments)
    assert (code, err) == (0, "")
    for words in ("to the left eye: system 2.00%", "to the right eye: system 3.00%", "BT.709",
                  "as --height, --distance, --adaptation were not", "white 36 cd/m²"):  # fmt: skip
        assert words in out
    scene = load_stereo(scene_file)
    assert scene.projector.primaries == "BT.709"
    assert (scene.projector.white, scene.projector.black) == pytest.approx((38, 0.15))
    assert scene.size == (1.2, 0.675)
    # What an eye sees is what its filter let through to the meter.
    light = np.array(CODES) ** 2.2
    pictures = np.stack(np.broadcast_arrays(light[:, None, None], light[None, :, None]))
    seen = scene.observation(5, 5).observe(np.repeat(pictures, 3, axis=-1)) - 0.15 / 38
    for view, slope in enumerate(SLOPES):
        own, other = pictures[view], pictures[1 - view]
        wanted = own + slope * other * (1 - 0.5 * own)
        assert seen[view] == pytest.approx(np.repeat(wanted, 3, axis=-1), abs=1e-8)
    code, out, _ = run(*arguments, "--json")
    figures = json.loads(out)
    assert figures["eyes"]["right"]["system_crosstalk"] == pytest.approx(0.03)
    assert figures["eyes"]["left"]["white_cd_m2"] == pytest.approx(40)
    assert figures["assumed"] == ["primaries", "height", "distance", "adaptation"]
    left, right = masters(tmp_path)
    shows = ("--left", left, "--right", right, "--scene", scene_file)
    assert run("compensate", *shows, "--out", tmp_path / "out")[::2] == (0, "")


@pytest.mark.parametrize(
    ("eyes", "slopes", "options", "words"),
    [
        (("left",), SLOPES, (), ("grey.csv", "both filters", "none through the right")),
        (("left", "right"), (0.02, 0.95), (), ("grey.csv", "grey-to-grey table", "95%")),
        (("left", "right"), SLOPES, ("--primaries", "sYCC"), ("--primaries 'sYCC'", "BT.709")),
        (("left", "right"), SLOPES, ("--width", "0"), ("--width must be above 0",)),
    ],
)
def test_grey_to_grey_that_is_no_scene(run, tmp_path, eyes, slopes, options, words):
    readings = grey_readings(tmp_path / "grey.csv", eyes, slopes)
    outcome = run("measure", "grey-to-grey", readings, "--out", tmp_path / "s.toml", *options)
    refused(outcome, *words)
    assert written(tmp_path) == ["grey.csv"]


# What is refused.

HEADER = "projector,filter,channel,level,X,Y,Z"


def test_readings_that_are_refused_leave_nothing(run, rig, tmp_path):
    rig.write_text(f"{rig.read_text()}\nleft,left,R,1,-1,2,3")
    before, arguments = written(tmp_path), ("--out", tmp_path / "s.toml", "--json")
    refused(run("measure", "crosstalk", rig, *arguments), str(rig), "X must be 0 to 1e+06, got -1")
    assert written(tmp_path) == before


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--out", "s.csv"], ("s.csv", ".toml", "name it so")),
        (["--out", "s.toml", "--width", "0"], ("--width must be above 0", "got 0")),
        (["--out", "s.toml", "--height", "nan"], ("--height must be above 0", "got nan")),
        (["--out", "s.toml", "--distance", "-1"], ("--distance", "got -1")),
        (["--out", "s.toml", "--adaptation", "0"], ("--adaptation", "got 0")),
        (["--out", "s.toml", "--black", "none"], ("--black 'none'", "included or subtracted")),
    ],
)
def test_impossible_settings(run, rig, tmp_path, monkeypatch, options, words):
    monkeypatch.chdir(tmp_path)
    before = written(tmp_path)
    assert len(refused(run("measure", "crosstalk", rig, *options), *words)) == 1
    assert written(tmp_path) == before


def test_the_scene_does_not_replace_the_readings(run, tmp_path):
    path = tmp_path / "rig.toml"
    rows = [
        f'[[reading]]\nprojector = "{p}"\nfilter = "{f}"\nchannel = "{c}"\nlevel = {level}\n'
        f"X = {x}\nY = {y}\nZ = {z}\n"
        for p, f, c, level, x, y, z in RIG.rows(5)
    ]
    path.write_text("\n".join(rows))
    refused(run("measure", "crosstalk", path, "--out", path), "rig.toml", "the input itself")
    assert path.read_text() == "\n".join(rows)
    assert run("measure", "crosstalk", path, "--out", tmp_path / "s.toml")[0] == 0
    load_stereo(tmp_path / "s.toml")


def test_a_pair_is_not_a_display(run, rig):
    refused(run("measure", "response", rig), "rig.csv", "domesim measure crosstalk")
    refused(run("measure", "response", rig.with_name("no.csv")), "no.csv", "check the path")


# A projector with measured primaries.


def measured(matrix=None):
    return Projector(MEASURED, 50.0, 0.1, relative_primaries(LEFT if matrix is None else matrix))


@pytest.mark.parametrize("source", PRIMARIES)
def test_measured_primaries_decode_and_encode(source):
    pixels = np.random.default_rng(0).random((2, 5, 7, 3), np.float32)
    light = measured().decode(pixels, SRGB(), source)
    assert light.dtype == np.float32
    assert measured().encode(light, SRGB(), source) == pytest.approx(pixels, abs=2e-5)
    if source not in CINEMA:
        white = measured().decode(np.ones((1, 1, 1, 3)), Linear(), source)
        assert white == pytest.approx(1, abs=1e-4)


def test_measured_primaries_of_a_standard_are_the_standards():
    xyz = 80 * Projector("BT.2020", 80.0).to_xyz
    ours, named = measured(xyz), Projector("BT.2020", 80.0)
    pixels = np.random.default_rng(1).random((1, 5, 7, 3))
    wanted = named.decode(pixels, Linear(), "BT.709")
    assert ours.decode(pixels, Linear(), "BT.709") == pytest.approx(wanted, abs=1e-9)
    assert ours.to_display(pixels) == pytest.approx(named.to_display(pixels), abs=1e-9)
    assert ours.luminance_weights == pytest.approx(named.luminance_weights)


def test_what_measured_primaries_mean():
    assert measured().to_xyz == pytest.approx(LEFT / LEFT[1].sum())
    assert measured().luminance_weights == pytest.approx(LEFT[1] / LEFT[1].sum())
    # XYZ is colorimetric: a master's XYZ comes out of the projector as it is.
    xyz = np.array([[[[0.2, 0.3, 0.25]]]])
    light = measured().decode(xyz, Linear(), "XYZ")
    assert light @ (LEFT / LEFT[1].sum()).T == pytest.approx(xyz)


@pytest.mark.parametrize(
    ("name", "matrix", "message"),
    [
        ("BT.709", relative_primaries(LEFT), "must be called 'measured'"),
        (MEASURED, None, "'measured' are not known"),
        (MEASURED, tuple(map(tuple, LEFT)), "Y = 1 at white, got 50.9"),
        (MEASURED, relative_primaries(LEFT[:, [0, 0, 1]]), "three colours"),
        (MEASURED, ((np.nan,) * 3,) * 3, "finite"),
    ],
)
def test_impossible_measured_primaries(name, matrix, message):
    with pytest.raises(InputError, match=message):
        Projector(name, 50.0, 0.1, matrix)
