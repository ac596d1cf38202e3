"""Mistakes of scene files, of domes and of 3D screens: one line each, that names the key."""

from __future__ import annotations

from pathlib import Path

import pytest
from stored_masters import store, touched

from domesim.errors import InputError
from domesim.scene import load_scene
from domesim.scene.loading import scene_of_text

DOME = """
name = "a test"
dome = { radius_m = 5.0 }
screen = { albedo = 0.45 }
projector = { white_cd_m2 = 13.7 }
viewing = { adaptation_cd_m2 = 1.4 }
"""
DOMES: dict[str, tuple[tuple[str, str], tuple[str, ...]]] = {
    "quoted key": (("radius_m", '"a b" = 1, radius_m'), ('dome."a b"', "known: radius_m")),
    "no section": (("{ radius_m = 5.0 }", "5"), ("dome: must be a section [dome]", "got 5")),
    "albedo of four": (("0.45", "[0, 0, 0, 0]"), ("screen.albedo", "3 values", "got [0, 0, 0, 0]")),
    "radius as text": (("5.0", "'5.0'"), ("dome.radius_m", "valid number, got '5.0'")),
    "long text": (("5.0", f"'{'5' * 9999}'"), ("dome.radius_m", "valid number", "got '555")),
    "black above white": (("13.7", "13.7, black_cd_m2 = 14"), ("projector: ", "below white")),
    "primaries": (("{ white", '{ primaries = "sYCC", white'), ("'sYCC' are not known",)),
    "closed white sphere": (
        ("5.0 }\nscreen = { albedo = 0.45", "5.0, half_angle_deg = 180 }\nscreen = { albedo = 1"),
        ("albedo 1", "never loses light", "lower the albedo"),
    ),
    "syntax": (("{ radius_m", "radius_m"), ("not valid TOML", "line 3")),
    "key twice": (("radius_m", "radius_m = 3, radius_m"), ("not valid TOML", "line 3")),
    "number too long": (("5.0", "5" * 9999), ("not valid TOML", "digits")),
    "too deep": (("5.0", "[" * 9999), ("not valid TOML", "recursion")),
}


@pytest.mark.parametrize("case", DOMES)
def test_a_mistake_of_a_dome_is_one_line(case: str) -> None:
    change, words = DOMES[case]
    is_refused(DOME, [change], words)


def is_refused(text: str, changes: list[tuple[str, str]], words: tuple[str, ...]) -> None:
    assert scene_of_text(text, "my.toml", Path()).name == "a test"
    for before, after in changes:
        assert before in text
        text = text.replace(before, after, 1)
    with pytest.raises(InputError) as refused:
        scene_of_text(text, "my.toml", Path())
    message = str(refused.value)
    assert message.startswith("my.toml")
    assert "\n" not in message
    assert len(message) < 400
    for word in words:
        assert word in message


def test_all_mistakes_of_a_scene_in_one_go() -> None:
    text = DOME
    for before, after in {
        "5.0": "0, titl_deg = 3",
        "0.45": "[0.4, 1.2, -1]",
        "white_cd_m2": "whit_cd_m2",
        "1.4": '"bright"',
    }.items():
        text = text.replace(before, after, 1)
    with pytest.raises(InputError) as refused:
        scene_of_text(text, "my.toml", Path())
    assert str(refused.value).splitlines() == [
        "my.toml has 7 mistakes:",
        "  dome.radius_m: must be greater than 0, got 0",
        "  dome.titl_deg: is not a key of a scene (did you mean 'tilt_deg'?)",
        "  screen.albedo[1]: must be less than or equal to 1, got 1.2",
        "  screen.albedo[2]: must be greater than or equal to 0, got -1",
        "  projector.lumens: is missing, and so is white_cd_m2: one of the two says how bright",
        "  projector.whit_cd_m2: is not a key of a scene (did you mean 'white_cd_m2'?)",
        "  viewing.adaptation_cd_m2: must be a valid number, got 'bright'",
    ]


def test_files_that_are_no_text(tmp_path: Path) -> None:
    for path in (touched(tmp_path / "b.toml", bytes(range(256))), store(tmp_path / "s.exr")):
        with pytest.raises(InputError, match=f"{path}.*TOML text file in UTF-8"):
            load_scene(path)


PAIR = """
name = "a test"
screen = { width_m = 2.5, height_m = 1.4 }
projector = { white_cd_m2 = 50 }
crosstalk = { share = 0.02 }
viewing = { distance_m = 3, adaptation_cd_m2 = 5 }
seats = [{ name = "middle" }, { name = "side", map = [[1, 2]] }]
"""
HARDWARE = (
    "crosstalk.polarisation = { lenses_m = [[-0.2, -30, 2], [0.2, -30, 2]], roughness = 0.3, "
    "depolarising_share = 0.04 }"
)
TABLE = "crosstalk.table = {{ levels = {}, to_left = {}, to_right = {} }}"
READINGS = 'crosstalk.readings = "no.csv"'
SHARE, SEATS = "crosstalk = { share = 0.02 }", PAIR.splitlines()[-1]
PAIRS: dict[str, tuple[dict[str, str], tuple[str, ...]]] = {
    "no way": ({SHARE: "crosstalk = {}"}, ("crosstalk: ", "one way", "got none")),
    "two ways": (
        {SHARE: 'crosstalk = { share = 0.02, readings = "r.csv" }'},
        ("crosstalk: ", "one way", "got share and readings"),
    ),
    "one direction": (
        {SHARE: "crosstalk = { to_left = 0.02 }"},
        ("crosstalk: ", "both to_left and to_right"),
    ),
    "no section": ({SHARE: "crosstalk = 0.02"}, ("crosstalk: ", "a section [crosstalk]")),
    "unknown key": ({"share": "shares"}, ("crosstalk.shares: ", "did you mean 'share'")),
    "no crosstalk": ({SHARE: ""}, ("needs [crosstalk] (3D)",)),
    "percent": ({"share = 0.02": "share = 2"}, ("crosstalk.share: ", "0.9", "got 2")),
    "negative": (
        {"share = 0.02": "share = -0.02"},
        ("to the left eye", "must add light", "got -0.02", "exchanged"),
    ),
    "too much at a seat": (
        {"[[1, 2]]": "[[1, 60]]"},
        ("seat 'side': ", "to the left eye", "well below", "120%"),
    ),
    "a ragged map": ({"[[1, 2]]": "[[1, 2], [1]]"}, ("seats[1]: ", "map", "all as long")),
    "two maps": (
        {"map = [[1, 2]]": "map = [[1]], map_left = [[1]], map_right = [[1]]"},
        ("seats[1]: ", "give one of the two"),
    ),
    "half a map": ({"map =": "map_left ="}, ("seats[1]: ", "both map_left and map_right")),
    "seats of one name": ({'"side"': '"middle"'}, ("seats: ", "must differ", "middle")),
    "a seat called all": ({'"side"': '"all"'}, ("seats: ", "'all'", "several")),
    "no position": ({SHARE: HARDWARE}, ("seats[0].position_m: ", "is missing")),
    "hardware without seats": (
        {SHARE: HARDWARE, SEATS: ""},
        ("seats: ", "polarisation depends on the seat"),
    ),
    "a table that is not square": (
        {SHARE: TABLE.format("[0, 1]", "[[0, 0.1]]", "[[0, 0.1], [0, 0]]"), ", map = [[1, 2]]": ""},
        ("crosstalk.table: ", "to_left: must be 2 rows of 2"),
    ),
    "primaries": (
        {"white_cd": 'primaries = "sYCC", white_cd'},
        ("projector: ", "'sYCC' are not known", "BT.709", "or measured with [crosstalk] readings"),
    ),
    "measured by nothing": (
        {"white_cd_m2 = 50": 'primaries = "measured"'},
        ("projector.primaries: ", "need [crosstalk] readings", "name the primaries"),
    ),
    "no white": ({"white_cd_m2 = 50": ""}, ("projector.white_cd_m2: is missing",)),
    "black of no readings": (
        {"share = 0.02": 'share = 0.02, black = "subtracted"'},
        ("crosstalk: ", "black says how to take readings", "leave it out"),
    ),
    "primaries beside readings": (
        {SHARE: READINGS, "white_cd": 'primaries = "P3-D65", white_cd'},
        ("projector.primaries: ", "leave primaries out"),
    ),
    "readings that are not there": (
        {SHARE: READINGS, "white_cd_m2 = 50": ""},
        ("no.csv", "No such file", "check the path"),
    ),
}


@pytest.mark.parametrize("case", PAIRS)
def test_a_mistake_of_a_3d_screen_is_one_line(case: str) -> None:
    changes, words = PAIRS[case]
    is_refused(PAIR, list(changes.items()), words)


def test_a_misspelt_section_is_no_dome() -> None:
    with pytest.raises(InputError) as refused:
        scene_of_text(PAIR.replace("crosstalk =", "crosstlk ="), "my.toml", Path())
    assert [line.strip() for line in str(refused.value).splitlines()[1:]] == [
        "crosstalk: is missing",
        "crosstlk: is not a key of a scene (did you mean 'crosstalk'?)",
    ]
