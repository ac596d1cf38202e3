"""Test patterns: what is lit is what the list says, and a picture that is turned is noticed."""

from __future__ import annotations

import csv
import json
import re

import numpy as np
import pytest
from rigs import refused

from domesim.errors import InputError
from domesim.frames import read_frame
from domesim.measure.patterns import Codes
from domesim.measure.patterns.dome import LARGER, dome_patterns
from domesim.measure.patterns.listing import read_patterns
from domesim.measure.patterns.stereo import stereo_patterns
from domesim.readings.meter import read_readings
from domesim.room.dome import Dome

EIGHT = Codes(8, floating=False, transfer="srgb")
DOMES = {
    "hemisphere": Dome(1.0, np.pi / 2),
    "ellipsoid": Dome(7.0, 1.2, height_ratio=0.8),
    "truncated": Dome(9.0, 1.9, tilt=0.3, truncated_below=-1.0),
}
SIZE, FLAT = 96, (54, 96)


def by_name(patterns):
    return {pattern.name: pattern for pattern in patterns}


def of_kind(patterns, kind):
    return [pattern for pattern in patterns if pattern.kind == kind]


@pytest.mark.parametrize("dome", DOMES.values(), ids=DOMES)
@pytest.mark.parametrize("kind", ["sector", "ring"])
def test_parts_make_up_the_screen(dome, kind):
    parts = of_kind(dome_patterns(dome, EIGHT, 4), kind)
    lit = sum(pattern.mask(SIZE, SIZE).astype(int) for pattern in parts)
    assert np.array_equal(lit[0], dome.inside(SIZE, SIZE))


@pytest.mark.parametrize("dome", DOMES.values(), ids=DOMES)
def test_halves_and_sectors_have_their_share_of_the_true_area(dome):
    """Front and back of a truncated dome differ; left and right do not."""
    patterns = by_name(dome_patterns(dome, EIGHT, 4))
    areas = dome.screen_areas(SIZE, SIZE)
    shares = {name: p.lit_share(p.mask(SIZE, SIZE), areas)[0] for name, p in patterns.items()}
    for name in ("half-left", "half-right"):
        assert shares[name] == pytest.approx(0.5, abs=1e-12)
    assert shares["half-front"] + shares["half-back"] == pytest.approx(1, abs=1e-12)
    assert shares["white"] == pytest.approx(1, abs=1e-12)
    assert shares["black"] == 0
    if dome.truncated_below is None:
        assert shares["half-front"] == pytest.approx(0.5, abs=1e-12)
        sectors = [share for name, share in shares.items() if name.startswith("sector")]
        assert sectors == pytest.approx([1 / 6] * 6, rel=0.02)
        # Theta of rings is proportional to the radius: area 1 - cos(theta) of a sphere
        if dome.height_ratio == 1:
            assert shares["ring-1"] == pytest.approx(1 - np.cos(dome.half_angle / 3), rel=0.02)


def test_halves_are_where_they_say():
    patterns = by_name(dome_patterns(DOMES["hemisphere"], EIGHT, 4))
    inside = DOMES["hemisphere"].inside(SIZE, SIZE)
    front, right = (patterns[f"half-{side}"].mask(SIZE, SIZE)[0] for side in ("front", "right"))
    assert np.array_equal(front, inside & (np.arange(SIZE) >= SIZE // 2)[:, None])
    assert np.array_equal(right, inside & (np.arange(SIZE) >= SIZE // 2))


@pytest.mark.parametrize("size", [64, 96, 102])
@pytest.mark.parametrize("dome", DOMES.values(), ids=DOMES)
def test_boards_on_domes_complement_each_other(dome, size):
    patterns = by_name(dome_patterns(dome, EIGHT, 4))
    boards = of_kind(patterns.values(), "checkerboard")
    assert len(boards) == 4
    for board in boards:
        other = patterns[board.parameters["complement"]]
        both = board.codes(size, size) + other.codes(size, size)
        assert np.array_equal(both, patterns["white"].codes(size, size))
        areas = dome.screen_areas(size, size)
        (share,) = board.lit_share(board.mask(size, size), areas)
        # Pixels on a cut edge give their areas to neighbours, not symmetrically.
        assert share == pytest.approx(0.5, abs=1e-12 if dome.truncated_below is None else 5e-4)


@pytest.mark.parametrize("size", [(54, 96), (1080, 1998), (66, 130)])
def test_boards_on_screens_complement_each_other(size):
    patterns = by_name(stereo_patterns(EIGHT, 4))
    boards = of_kind(patterns.values(), "checkerboard")
    assert len(boards) == 8
    for board in boards:
        other = patterns[board.parameters["complement"]]
        eye = board.parameters["projector"]
        both = board.codes(*size) + other.codes(*size)
        assert np.array_equal(both, patterns[f"{eye}-white"].codes(*size))
        shares = board.lit_share(board.mask(*size), np.ones(size))
        assert sorted(shares) == [0, 0.5]
        assert shares[["left", "right"].index(eye)] == 0.5


def test_fields_of_a_board():
    board = by_name(stereo_patterns(EIGHT, 4))["left-checkerboard-4x2-a"].mask(4, 8)[0]
    assert board.astype(int).tolist() == [[1, 1, 0, 0, 1, 1, 0, 0]] * 2 + [[0, 0, 1, 1] * 2] * 2


def test_patches_are_around_their_middle():
    dome = DOMES["hemisphere"]
    patches = of_kind(dome_patterns(dome, EIGHT, 4), "patch")
    assert len(patches) == 13
    areas = dome.screen_areas(256, 256)
    for patch in patches:
        mask = patch.mask(256, 256)
        mean = np.sum((areas * mask[0])[..., None] * dome.directions(256, 256), (0, 1))
        a, t = np.radians([patch.parameters["azimuth_deg"], patch.parameters["angle_deg"]])
        middle = [np.sin(t) * np.cos(a), np.sin(t) * np.sin(a), np.cos(t)]
        assert mean / np.linalg.norm(mean) == pytest.approx(middle, abs=2e-3)
        radius = np.radians(patch.parameters["radius_deg"])
        assert patch.lit_share(mask, areas)[0] == pytest.approx(1 - np.cos(radius), rel=0.05)


# Orientation


def turned(picture):
    """The picture's seven other orientations (of a square), or three."""
    flips = [picture[::-1], picture[:, ::-1], picture[::-1, ::-1]]
    if picture.shape[0] != picture.shape[1]:
        return flips
    return [*flips, *(np.swapaxes(each, 0, 1) for each in (picture, *flips))]


def unlike(one, other):
    """Share of lit pixels that differ."""
    return np.mean((one != other)[one | other])


def test_markers_on_a_dome_break_every_symmetry():
    dome = DOMES["hemisphere"]
    (pattern,) = of_kind(dome_patterns(dome, EIGHT, 4), "registration")
    lit = pattern.mask(512, 512)[0]
    assert min(unlike(lit, other) for other in turned(lit)) > 0.15
    markers = pattern.parameters["markers"]
    sizes = {(m["azimuth_deg"], round(m["angle_deg"])): m["radius_deg"] for m in markers}
    ring = np.array([sizes[azimuth, 54] for azimuth in range(0, 360, 30)])
    for step in range(1, 12):
        assert not np.array_equal(ring, np.roll(ring, step))
        assert not np.array_equal(ring, np.roll(ring[::-1], step))
    assert ring[3] == 2 * ring[1]
    assert set(LARGER) == {0, 90}


def test_markers_on_a_screen_break_every_symmetry():
    (pattern,) = of_kind(stereo_patterns(EIGHT, 4), "registration")
    left, right = pattern.mask(270, 480)
    for lit in (left, right):
        assert min(unlike(lit, other) for other in turned(lit)) > 0.15
    assert unlike(left, right) > 0.05


def test_markers_off_a_truncated_screen_are_left_out():
    dome = DOMES["truncated"]
    (pattern,) = of_kind(dome_patterns(dome, EIGHT, 4), "registration")
    markers = pattern.parameters["markers"]
    assert 15 < len(markers) < 37
    for m in markers:
        a, t = np.radians([m["azimuth_deg"], m["angle_deg"]])
        height = dome.surface(t, a) @ dome.to_room[2]
        assert height > -1.05


# Files


@pytest.mark.parametrize(
    ("options", "largest"),
    [
        (["--format", "png"], 255),
        (["--format", "png", "--bits", "16", "--encoding", "p3-dci"], 65535),
        (["--format", "dpx", "--encoding", "bt709"], 255),
        (["--format", "tif", "--bits", "12", "--encoding", "p3-dci"], 4095),
        (["--format", "exr"], None),
    ],
)
def test_codes_come_back_exactly(run, tmp_path, options, largest):
    code, out, err = run(
        "measure", "patterns", "--dome", "--size", "64", "--levels", "4", "--out", tmp_path,
        *options, "--json",
    )  # fmt: skip
    assert (code, err) == (0, "")
    listed = read_patterns(tmp_path)
    assert json.loads(out)["patterns"] == len(listed.patterns)
    dome = DOMES["hemisphere"]
    patterns = by_name(dome_patterns(dome, EIGHT, 4))
    for each in listed.patterns:
        (file,) = each.files
        frame = read_frame(tmp_path / file)
        assert frame.colour.assumed or frame.colour.transfer == listed.encoding["transfer"]
        on = patterns[each.name].mask(64, 64)[0]
        wanted = np.where(on[..., None], np.array(each.colours[0], np.float32), 0)
        assert np.array_equal(frame.pixels, wanted.astype(np.float32)), each.name
        if each.kind == "ramp" and largest:
            stored = each.parameters["level"] * largest
            assert stored == pytest.approx(round(stored), abs=1e-9)


def test_what_a_folder_of_a_dome_has(run, tmp_path):
    options = ("--size", "64", "--levels", "5", "--scene", "dome_planetarium")
    code, out, err = run("measure", "patterns", "--dome", *options, "--out", tmp_path)
    assert (code, err) == (0, "")
    assert "how-to.html" in out
    listed = read_patterns(tmp_path)
    assert listed.dome == {"half_angle_deg": pytest.approx(90), "tilt_deg": pytest.approx(15)}
    assert [each.number for each in listed.patterns] == [*range(1, len(listed.patterns) + 1)]
    assert len({each.name for each in listed.patterns}) == len(listed.patterns)
    files = {path.name for path in tmp_path.glob("[!.]*")}
    assert {file for each in listed.patterns for file in each.files} < files
    assert files - {file for each in listed.patterns for file in each.files} == {
        "how-to.html", "patterns.json", "readings.csv",
    }  # fmt: skip
    (registration,) = (each for each in listed.patterns if each.kind == "registration")
    pixels = read_frame(tmp_path / registration.files[0]).pixels
    for marker in registration.parameters["markers"]:
        if marker["radius_deg"] > 2.5:
            assert pixels[int(marker["row"] - 0.5), int(marker["col"] - 0.5), 0] == 1
    page = (tmp_path / "how-to.html").read_text()
    assert not re.search(r"(src|href)=.(?!data:)", page)
    assert page.count("<img") == len(listed.patterns)
    assert all(each.name in page for each in listed.patterns)


def test_tables_to_fill_in_are_read(run, tmp_path):
    """With figures in them, of course."""
    run("measure", "patterns", "--stereo", "--size", "96x64", "--levels", "4", "--out", tmp_path)
    path = tmp_path / "readings.csv"
    refused(run("measure", "response", path), "in X, Y, Z, got a table that nobody has filled in")
    rows = list(csv.DictReader(path.read_text().splitlines()))
    rows = [{**row, **dict.fromkeys("XYZ", "1")} for row in rows]
    with path.open("w") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    read = read_readings(path)
    assert set(read.sessions) == {(p, f) for p in ("left", "right") for f in ("left", "right")}
    own, leak = read.session("left", "left"), read.session("left", "right")
    assert [len(own.means[channel]) for channel in "WRGBK"] == [4, 4, 4, 4, 1]
    assert [len(leak.means[channel]) for channel in "WRGBK"] == [1] * 5
    greys = list(csv.DictReader((tmp_path / "grey-to-grey.csv").read_text().splitlines()))
    pairs = {(row["filter"], row["own_level"], row["other_level"]) for row in greys}
    assert len(pairs) == len(greys) == 2 * 25


def test_left_is_left(run, tmp_path):
    run("measure", "patterns", "--stereo", "--size", "96x64", "--levels", "4", "--out", tmp_path)
    listed = {each.name: each for each in read_patterns(tmp_path).patterns}
    green, grey = listed["left-green"], listed["grey-1-3"]
    left, right = (read_frame(tmp_path / file).pixels for file in green.files)
    assert [file.split("/")[0] for file in green.files] == ["left", "right"]
    assert left[5, 5].tolist() == [0, 1, 0]
    assert not right.any()
    left, right = (read_frame(tmp_path / file).pixels for file in grey.files)
    assert left[0, 0, 0] == pytest.approx(64 / 255)
    assert right[0, 0, 0] == pytest.approx(191 / 255)
    assert grey.parameters == {"left_level": 64 / 255, "right_level": 191 / 255}


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ([], "one of --dome and --stereo"),
        (["--dome", "--stereo"], "one of --dome and --stereo"),
        (["--dome", "--size", "65"], "even"),
        (["--dome", "--size", "64x64"], "a number of pixels"),
        (["--stereo", "--size", "64"], "width x height"),
        (["--dome", "--levels", "3"], "4..64"),
        (["--dome", "--format", "jpg"], "codes exactly"),
        (["--dome", "--format", "mov"], "codes exactly"),
        (["--dome", "--bits", "10"], "8 or 16"),
        (["--dome", "--encoding", "dcdm"], "projector's own"),
        (["--dome", "--encoding", "st2084"], "projector's own"),
        (["--dome", "--encoding", "acescg"], "projector's own"),
        (["--dome", "--encoding", "hlg"], "projector's own"),
        (["--stereo", "--scene", "dome_imax"], "--dome"),
        (["--dome", "--scene", "stereo_shutter"], "wanted a dome theatre"),
    ],
)
def test_refused_options(run, tmp_path, options, word):
    out = tmp_path / "out"
    lines = refused(run("measure", "patterns", *options, "--out", out), word)
    assert len(lines) == 1
    assert not out.exists()


@pytest.mark.parametrize("text", ["", "{}", '{"format": "domesim patterns 2"}', "[1]"])
def test_damaged_lists(tmp_path, text):
    with pytest.raises(InputError, match="wanted the list"):
        read_patterns(tmp_path)
    (tmp_path / "patterns.json").write_text(text)
    with pytest.raises(InputError, match=r"patterns\.json"):
        read_patterns(tmp_path)


@pytest.mark.parametrize(
    ("scene", "told"), [("dome_planetarium", True), ("dome_hemisphere", False)]
)
def test_a_room_that_needs_more_is_told_before_photographs(run, tmp_path, scene, told):
    size = ("--size", "64", "--levels", "4", "--scene", scene)
    _, out, _ = run("measure", "patterns", "--dome", *size, "--out", tmp_path)
    assert ("--without-geometry" in out) == told
