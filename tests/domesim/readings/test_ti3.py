"""ArgyllCMS's tables: the same display as from a CSV, and one clear line for broken ones."""

from __future__ import annotations

import re

import numpy as np
import pytest
from rigs import LEFT, RIGHT, Rig, refused

from domesim.readings.meter import read_readings
from domesim.readings.pair import measured_pair
from domesim.readings.response import measured_display
from domesim.scene import load_stereo

FIELDS = "SAMPLE_ID RGB_R RGB_G RGB_B XYZ_X XYZ_Y XYZ_Z"
BLACK = np.array([0.06, 0.063, 0.09])
LEVELS = [0.2, 0.4, 0.6, 0.8]


def xyz(rgb, primaries=LEFT, gamma=2.2):
    return primaries @ np.asarray(rgb, float) ** gamma + BLACK


def patches():
    """R, G, B in 0..1: greys, single primaries, and mixed colours."""
    for level in [0.0, *LEVELS, 1.0]:
        yield [level] * 3
    for primary in np.eye(3):
        for level in [*LEVELS, 1.0]:
            yield list(level * primary)
    yield [1.0, 1.0, 0.0]
    yield [0.2, 0.4, 0.6]


def ti3(rows=None, *, normalised=True, primaries=LEFT, luminance=None):
    white = xyz([1, 1, 1], primaries)
    scale = 100 / white[1] if normalised else 1.0
    found = rows or [
        " ".join(
            [
                str(n),
                *(f"{100 * c:.4f}" for c in rgb),
                *(f"{v * scale:.7f}" for v in xyz(rgb, primaries)),
            ]
        )
        for n, rgb in enumerate(patches(), 1)
    ]
    told = luminance or " ".join(f"{v:.6f}" for v in white)
    lines = [
        "CTI3   ",
        "",
        'DESCRIPTOR "Argyll Calibration Target chart information 3"',
        'ORIGINATOR "Argyll dispread"',
        'KEYWORD "DEVICE_CLASS"',
        'DEVICE_CLASS "DISPLAY"',
        'KEYWORD "LUMINANCE_XYZ_CDM2"',
        f'LUMINANCE_XYZ_CDM2 "{told}"',
        'KEYWORD "NORMALIZED_TO_Y_100"',
        f'NORMALIZED_TO_Y_100 "{"YES" if normalised else "NO"}"',
        'COLOR_REP "RGB_XYZ"',
        "",
        "NUMBER_OF_FIELDS 7",
        "BEGIN_DATA_FORMAT",
        f"{FIELDS} ",
        "END_DATA_FORMAT",
        "",
        f"NUMBER_OF_SETS {len(found)}",
        "BEGIN_DATA",
        *(f"{row} " for row in found),
        "END_DATA",
        "CAL    ",
        "BEGIN_DATA",
        "0.0 0.0",
        "END_DATA",
    ]
    return "\n".join(lines)


@pytest.fixture
def table(tmp_path):
    def made(text, name="rig.ti3"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return made


@pytest.mark.parametrize("normalised", [True, False])
def test_a_display_is_found_again(table, normalised):
    read = read_readings(table(ti3(normalised=normalised)))
    display = measured_display(read.session("display", "none"))
    assert read.left_out == 2
    assert display.primaries == pytest.approx(LEFT, rel=1e-5)
    assert display.black == pytest.approx(BLACK, abs=1e-5)
    assert display.response.transfer.exponent == pytest.approx(2.2, abs=1e-3)
    assert display.additivity == pytest.approx(0, abs=1e-5)


def test_the_command(run, table):
    code, out, err = run("measure", "response", table(ti3()))
    assert (code, err) == (0, "")
    assert f"white {LEFT.sum(1)[1]:.4g} cd/m²" in out
    assert "left out: 2 readings of mixed colours" in out


def spoilt(pattern, replacement, text=None):
    found, count = re.subn(pattern, replacement, text or ti3(), count=1, flags=re.MULTILINE)
    assert count == 1
    return found


ROW = r"^(7 0?20\.0000 0\.0000 0\.0000) (\S+) (\S+) (\S+)"
BROKEN = {
    "columns that are missing": (
        spoilt("RGB_B XYZ_X", "CMYK_C LAB_L"),
        "columns RGB_B, XYZ_X are missing",
    ),
    "a wrong kind": (spoilt("CTI3", "CTI1"), "begins with CTI3, got 'CTI1'"),
    "a printer": (spoilt('"DISPLAY"', '"OUTPUT"'), "wanted readings of a DISPLAY"),
    "codes of 8 bits": (
        spoilt(ROW, r"7 51 0 255 \2 \3 \4"),
        "RGB_B must be 0 to 100 (percent), got 255",
    ),
    "no unit": (spoilt("^LUMINANCE.*", ""), "no LUMINANCE_XYZ_CDM2 tells its cd/m²"),
    "a unit that is none": (ti3(luminance="1 -2 3"), "three numbers above 0"),
    "mixed units": (
        spoilt('NORMALIZED_TO_Y_100 "YES"', 'NORMALIZED_TO_Y_100 "NO"'),
        "are units mixed?",
    ),
    "a row in another unit": (
        ti3().replace("\n8 40.0000 0.0000 0.0000 ", "\n8 40.0000 0.0000 0.0000 9"),
        "light must rise",
    ),
    "negative light": (spoilt(ROW, r"\1 \2 -0.4 \4"), "Y must be 0 to 1e+06, got -0.2"),
    "NaN": (spoilt(ROW, r"\1 \2 nan \4"), "Y must be a number, got 'nan'"),
    "a row that is cut": (spoilt(ROW, r"\1 \2"), "must have 7 cells, got 5"),
    "rows that are missing": (spoilt(ROW, "# none"), "NUMBER_OF_SETS says 23 rows, got 22"),
    "an end that is missing": (ti3().split("END_DATA\n")[0], "ends before END_DATA"),
    "a half": (ti3()[: ti3().index("\n12 ")], "ends before END_DATA"),
    "nothing": ("", "got 'nothing'"),
    "decimal commas": (
        re.sub(r"(?<=[0-9])[.](?=[0-9])", ",", ti3()),
        "numbers have a decimal point, got '",
    ),
    "levels in 0..1": (
        re.sub(
            r"^(\d+) (\S+) (\S+) (\S+) ",
            lambda m: f"{m[1]} {float(m[2]) / 100} {float(m[3]) / 100} {float(m[4]) / 100} ",
            ti3(),
            flags=re.MULTILINE,
        ),
        "RGB must be in percent, got at most 1",
    ),
}


@pytest.mark.parametrize(("text", "word"), BROKEN.values(), ids=BROKEN)
def test_broken_tables(run, table, text, word):
    lines = refused(run("measure", "response", table(text)), "rig.ti3", word)
    if "has" not in lines[0]:
        assert len(lines) == 1


# Four tables of a pair


def of_rig(projector, through):
    rig = Rig(ramps=False)
    primaries = rig.primaries(projector, through)
    white = primaries.sum(1)
    rows = [([0, 0, 0], np.zeros(3)), ([100] * 3, white)]
    rows += [(list(100 * e), primaries @ e) for e in np.eye(3)]
    stored = [
        " ".join([str(n), *map(str, rgb), *(f"{v * 100 / white[1]:.9f}" for v in light)])
        for n, (rgb, light) in enumerate(rows, 1)
    ]
    return ti3(stored, luminance=" ".join(f"{v:.9f}" for v in white))


@pytest.fixture
def four(table):
    sections = []
    for projector in ("left", "right"):
        for through in ("left", "right"):
            name = f"{projector}-{through}.ti3"
            table(of_rig(projector, through), name)
            sections.append(
                f'[[table]]\nprojector = "{projector}"\nfilter = "{through}"\nfile = "{name}"\n'
            )
    return table("\n".join(sections), "rig.toml")


def test_four_tables_are_a_pair(run, four, tmp_path):
    pair = measured_pair(read_readings(four))
    rig = Rig()
    wanted = [np.array(rig.to_left), np.linalg.solve(RIGHT, rig.primaries("left", "right"))]
    assert pair.matrices == pytest.approx(np.stack(wanted), abs=1e-6)
    out = tmp_path / "out" / "rig.toml"
    code, _, err = run("measure", "crosstalk", four, "--out", out)
    assert (code, err) == (0, "")
    before = load_stereo(out).digest
    other = tmp_path / "left-right.ti3"
    other.write_text(other.read_text().replace("dispread", "spotread"))
    assert load_stereo(out).digest != before


@pytest.mark.parametrize(
    ("pattern", "replacement", "word"),
    [
        ('filter = "right"', 'filter = "green"', "filter must be left or right or none"),
        ('file = "left-left.ti3"', "file = 3", "file must be a path"),
        ('filter = "right"\n', "", "must have projector, filter and file"),
        ("left-left.ti3", "none.ti3", "none.ti3: wanted a file of readings"),
    ],
)
def test_wrong_names_of_tables(run, four, tmp_path, pattern, replacement, word):
    four.write_text(four.read_text().replace(pattern, replacement, 1))
    lines = refused(run("measure", "crosstalk", four, "--out", tmp_path / "o.toml"), word)
    assert len(lines) == 1
