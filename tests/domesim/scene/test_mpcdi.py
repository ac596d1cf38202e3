"""Projectors and blends from and to MPCDI: geometry by hand, light from one's own to one's own."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import Run
from PIL import Image

from domesim.errors import InputError
from domesim.room.beams import on_screen
from domesim.room.dome import Dome
from domesim.room.lenses import field_edges, field_weight, lens_frame
from domesim.room.theatre import Lens, Theatre
from domesim.room.unlit import uplift
from domesim.scene import load_dome
from domesim.scene.mpcdi import blend_sums, landing, read_mpcdi, written_mpcdi
from domesim.scene.writing import as_toml

DOME = Dome(5.0, np.radians(90), 0.3)
SURVEYOR = {"yaw": (0, 0, -1), "pitch": (1, 0, 0), "roll": (0, 1, 0)}
OPEN_GL = {"yaw": (0, -1, 0), "pitch": (1, 0, 0), "roll": (0, 0, -1)}
WHOLE = """
[dome]
radius_m = 5.0
tilt_deg = 10.0
[screen]
albedo = 0.5
[projector]
white_cd_m2 = 20
[viewing]
adaptation_cd_m2 = 1.0
"""


def ring(count: int = 4) -> list[Lens]:
    """Projectors round the dome that throw across, and one up; rolled, shifted, soft."""
    lenses = []
    for k in range(count):
        angle = 2 * np.pi * k / count
        x, y = 3.0 * float(np.sin(angle)), 3.0 * float(np.cos(angle))
        place, across = (x, y, -0.5), (-x, -y, 2.5)
        lenses.append(
            Lens(f"P{k + 1}", place, across, 0.05 * k, "perspective", 1.9, 1.6, 0.4, (0.02, 0.1))
        )
    top = Lens("top", (0.1, -0.2, -1.0), (0.1, -0.2, 9.0), 0.3, "perspective", 2.2, 1.0, 0.4)
    return [*lenses, top]


def theatre(lenses: list[Lens], **more: Any) -> Theatre:
    return Theatre(DOME, (0.5, 0.5, 0.5), lenses=tuple(lenses), **more)


def scene_file(folder: Path, lenses: list[Lens]) -> Path:
    text = f'name = "made up"\n{WHOLE}'
    for lens in lenses:
        text += f"""[[projector.units]]
name = "{lens.name}"
position_m = {list(lens.position)}
look_at_m = {list(lens.look_at)}
roll_deg = {np.degrees(lens.roll)}
kind = "{lens.kind}"
field_deg = {np.degrees(lens.field)}
aspect = {lens.aspect}
blend_deg = {np.degrees(lens.blend)}
shift = {list(lens.shift)}
"""
    (folder / "theatre.toml").write_text(text)
    return folder / "theatre.toml"


def texts(node: str, values: dict[str, Any]) -> str:
    inner = "".join(f"<{name}>{value}</{name}>" for name, value in values.items())
    return f"<{node}>{inner}</{node}>"


def xml(
    *,
    frustum: dict[str, float],
    position: tuple[float, float, float] = (1, 2, 3),
    axes: dict[str, tuple[int, int, int]] = SURVEYOR,
    profile: str = "sl",
    files: str = "",
    attribute: str = "xResolution",
) -> str:
    """As programs write it: see the standard's own layout."""
    angles = {"yaw": 0, "pitch": 0, "roll": 0, "rightAngle": 30, "leftAngle": -30,
              "upAngle": 20, "downAngle": -20, **frustum}  # fmt: skip
    vectors = {"pos": position, **axes}
    frame = {
        f"{name}{axis}": value
        for name, vector in vectors.items()
        for axis, value in zip("xyz", vector, strict=True)
    }
    down = attribute.replace("x", "y", 1).replace("X", "Y", 1)
    return f"""<?xml version="1.0" encoding="utf-8"?>
<MPCDI profile="{profile}" geometry="1" color="1" date="2026-11-25 19:30:11" version="2.0">
  <display><buffer id="b">
    <region id="one" {attribute}="64" {down}="40" x="0" y="0" xsize="1" ysize="1">
      {texts("frustum", angles)}{texts("coordinateFrame", frame)}
    </region></buffer></display>
  <files>{files}</files>
</MPCDI>"""


def package(path: Path, content: str, **files: bytes) -> Path:
    with zipfile.ZipFile(path, "w") as made:
        made.writestr("mpcdi.xml", content)
        for name, data in files.items():
            made.writestr(name.replace("_", "."), data)
    return path


def packed(path: Path, files: dict[str, bytes]) -> None:
    with zipfile.ZipFile(path, "w") as made:
        for name, data in files.items():
            made.writestr(name, data)


def fileset(**paths: str) -> str:
    inner = "".join(
        f"<{kind}><path>{path}</path><geometricUnit>mm</geometricUnit>"
        f"<gammaEmbedded>2.2</gammaEmbedded></{kind}>"
        for kind, path in paths.items()
    )
    return f'<fileset region="one">{inner}</fileset>'


def png(codes: np.ndarray) -> bytes:
    made = io.BytesIO()
    Image.fromarray(codes).save(made, "PNG")
    return made.getvalue()


def pfm(points: np.ndarray, order: str = "<") -> bytes:
    rows, cols = points.shape[:2]
    scale = "-1.0" if order == "<" else "1.0"
    return f"PF\n{cols} {rows}\n{scale}\n".encode() + points[::-1].astype(f"{order}f4").tobytes()


@pytest.mark.parametrize(
    ("turn", "forward", "right"),
    [
        ({}, (0, 1, 0), (1, 0, 0)),
        ({"yaw": 90}, (1, 0, 0), (0, -1, 0)),
        ({"yaw": 90, "pitch": 90}, (0, 0, 1), (0, -1, 0)),
        ({"roll": 90}, (0, 1, 0), (0, 0, -1)),  # the left wing is up, the right one down
    ],
)
@pytest.mark.parametrize(("axes", "place"), [(SURVEYOR, (1, 2, 3)), (OPEN_GL, (1, 3, -2))])
def test_yaw_pitch_and_roll_are_a_pilots(
    tmp_path: Path, turn: dict[str, float], forward: Any, right: Any, axes: Any, place: Any
) -> None:
    """The same projector, whichever way a file's coordinates are turned."""
    path = package(tmp_path / "x.mpcdi", xml(frustum=turn, axes=axes, position=place))
    (region,) = read_mpcdi(path)
    np.testing.assert_allclose(region.lens.position, (1, 2, 3), atol=1e-12)
    found_right, _, found_forward = lens_frame(region.lens)
    np.testing.assert_allclose(found_forward, forward, atol=1e-12)
    np.testing.assert_allclose(found_right, right, atol=1e-12)


@pytest.mark.parametrize("attribute", ["xResolution", "Xresolution", "XResolution"])
def test_a_shifted_field_keeps_its_angles(tmp_path: Path, attribute: str) -> None:
    frustum = {"leftAngle": -12.0, "rightAngle": 31.0, "downAngle": 3.0, "upAngle": 28.0}
    path = tmp_path / "x.mpcdi.xml"  # some programs write the XML alone
    path.write_text(xml(frustum=frustum, attribute=attribute))
    (region,) = read_mpcdi(path)
    assert region.size == (64, 40)
    low, high = field_edges(region.lens)
    np.testing.assert_allclose(np.degrees(np.arctan(low)), (-12, 3), atol=1e-9)
    np.testing.assert_allclose(np.degrees(np.arctan(high)), (31, 28), atol=1e-9)
    right, up, forward = lens_frame(region.lens)
    for across, rise, lit in ((30, 20, 1), (32, 20, 0), (-11, 20, 1), (-13, 20, 0), (0, 2, 0)):
        ray = forward + np.tan(np.radians(across)) * right + np.tan(np.radians(rise)) * up
        assert field_weight(region.lens, np.array(region.lens.position) + 7 * ray) == lit


def test_an_alpha_map_is_a_share_of_light(tmp_path: Path) -> None:
    """Codes have a gamma in them; the first row is at the top."""
    codes = np.zeros((40, 64), np.uint8)
    codes[:20, :32] = 128
    path = package(
        tmp_path / "x.mpcdi",
        xml(frustum={}, files=fileset(alphaMap="a.png")),
        a_png=png(codes),
    )
    (region,) = read_mpcdi(path)
    right, up, forward = lens_frame(region.lens)
    for across, rise, share in ((-1, 1, (128 / 255) ** 2.2), (1, 1, 0), (-1, -1, 0)):
        ray = forward + 0.2 * across * right + 0.15 * rise * up
        found = field_weight(region.lens, np.array(region.lens.position) + ray)
        assert found == pytest.approx(share, abs=1e-12)


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_lens_that_distorts_has_its_blend_where_light_lands(tmp_path: Path, order: str) -> None:
    codes = np.repeat(np.linspace(0, 255, 64)[None], 40, axis=0).astype(np.uint8)
    (ideal,) = read_mpcdi(package(tmp_path / "i.mpcdi", xml(frustum={})))
    row, col = np.mgrid[:40, :64]
    place = np.stack([(col + 0.5) / 64, 1 - (row + 0.5) / 40], -1) - 0.5
    bent = place * (0.9 - 0.15 * np.sum(place**2, axis=-1, keepdims=True)) + 0.5
    low, high = field_edges(ideal.lens)
    right, up, forward = lens_frame(ideal.lens)
    tangents = low + bent * (high - low)
    rays = forward + tangents[..., :1] * right + tangents[..., 1:] * up
    points = np.asarray(ideal.lens.position) + 4 * rays
    files = fileset(alphaMap="a.png", geometryWarpFile="w.pfm")
    content = package(
        tmp_path / "x.mpcdi", xml(frustum={}, files=files),
        a_png=png(codes), w_pfm=pfm(points * 1000, order),
    )  # fmt: skip
    (region,) = read_mpcdi(content)
    assert region.points is not None
    np.testing.assert_allclose(region.points, points, atol=1e-5)
    inner = (slice(3, -3), slice(3, -3))
    found = field_weight(region.lens, points)[inner]
    np.testing.assert_allclose(found, ((codes / 255) ** 2.2)[inner], atol=0.01)


def test_what_is_exported_sums_to_one_and_comes_back(tmp_path: Path) -> None:
    lenses = ring()
    path = tmp_path / "x.mpcdi"
    path.write_bytes(written_mpcdi(theatre(lenses), (480, 300), "2026-11-25 19:30:11"))
    regions = read_mpcdi(path)
    back = [region.lens for region in regions]
    for old, new, region in zip(lenses, back, regions, strict=True):
        assert new.name == old.name
        np.testing.assert_allclose(new.position, old.position, atol=1e-9)
        np.testing.assert_allclose(lens_frame(new), lens_frame(old), atol=1e-9)
        np.testing.assert_allclose(field_edges(new), field_edges(old), rtol=1e-9)
        points = landing(DOME, old, 300, 480)
        np.testing.assert_allclose(np.linalg.norm(points, axis=-1), 5.0, rtol=1e-12)
        assert region.points is not None
        on = np.isfinite(region.points).all(axis=-1)
        assert 0.2 < on.mean() < 1
        np.testing.assert_allclose(region.points[on], points[on], atol=1e-5)
    assert max(abs(each - 1) for each in blend_sums(DOME, back, 200)) < 1e-3
    assert max(abs(each - 1) for each in blend_sums(DOME, lenses, 200)) > 0.1
    # At random places of the screen, too, and each projector's share is what it was
    points = DOME.points(97, 97)[DOME.inside(97, 97)]
    before = np.stack([field_weight(lens, points) for lens in lenses])
    after = np.stack([field_weight(lens, points) for lens in back])
    np.testing.assert_allclose(after, before / before.sum(0), atol=2e-3)


def test_a_beta_map_lifts_black(tmp_path: Path) -> None:
    """MPCDI 2.0 has it beside the alpha map, without a gamma of its own."""
    alpha = np.array([[0, 64, 128], [255, 192, 100]], np.uint8)
    beta = np.array([[0, 3, 10], [20, 5, 1]], np.uint8)
    files = fileset(alphaMap="a.png").replace(
        "</fileset>",
        "<betaMap><path>b.png</path><componentDepth>1</componentDepth><bitDepth>8</bitDepth>"
        "</betaMap></fileset>",
    )
    content = xml(frustum={}, files=files)
    path = package(tmp_path / "x.mpcdi", content, a_png=png(alpha), b_png=png(beta))
    (region,) = read_mpcdi(path)
    assert region.lens.mask is not None
    assert region.lens.uplift is not None
    np.testing.assert_allclose(region.lens.mask.weights, (alpha / 255) ** 2.2)
    np.testing.assert_allclose(region.lens.uplift.weights, (beta / 255) ** 2.2)


def dark_cove(**projector: Any) -> dict[str, Any]:
    """Three projectors that overlap, each with a black of its own."""
    units = [
        {"name": f"P{k}", "position_m": [3 * x, 3 * y, -0.5], "look_at_m": [-x, -y, 2.5],
         "kind": "perspective", "field_deg": 110.0, "aspect": 1.2, "blend_deg": 15.0,
         "black_cd_m2": 0.002 * (k + 1)}
        for k, (x, y) in enumerate(((0.0, 1.0), (0.87, -0.5), (-0.87, -0.5)))
    ]  # fmt: skip
    return {
        "name": "dark cove",
        "dome": {"radius_m": 5.0, "half_angle_deg": 60.0},
        "screen": {"albedo": 0.4},
        "projector": {"white_cd_m2": 10.0, "units": units, **projector},
        "viewing": {"adaptation_cd_m2": 1.0},
    }


def test_beta_maps_come_back_as_they_were_written(tmp_path: Path, run: Run) -> None:
    """What hides the overlaps is each projector's share of it, to half a code of 16 bits."""
    scene, path = tmp_path / "cove.toml", tmp_path / "cove.mpcdi"
    scene.write_text(as_toml(dark_cove(even_black="projectors")))
    assert run("scene", "export", scene, "--out", path, "--size", "240x200")[0] == 0
    room = load_dome(scene)
    for lens, region in zip(room.theatre.lenses, read_mpcdi(path), strict=True):
        points = landing(room.dome, lens, 200, 240)
        total = sum(field_weight(each, points) for each in room.theatre.lenses)
        lift = (
            field_weight(lens, points)
            / np.where(total > 0, total, 1)
            * uplift(room.theatre, points)
        )
        lift = np.where(on_screen(room.dome, points), lift, 0)
        assert lift.max() > 2e-4
        assert region.lens.uplift is not None
        codes = [np.rint(65535 * each ** (1 / 2.2)) for each in (lift, region.lens.uplift.weights)]
        np.testing.assert_array_equal(*codes)
    back = tmp_path / "back.toml"
    assert run("scene", "import", path, "--out", back, "--like", scene)[0] == 0
    again = tmp_path / "again.mpcdi"
    assert run("scene", "export", back, "--out", again, "--size", "240x200")[0] == 0
    for one, other in zip(read_mpcdi(path), read_mpcdi(again), strict=True):
        assert one.lens.uplift is not None
        assert other.lens.uplift is not None
        off = np.abs(one.lens.uplift.weights - other.lens.uplift.weights)
        assert off.mean() < 0.01 * one.lens.uplift.weights.mean()
    seen, found = (
        load_dome(each).observation(64, 64).observe(np.zeros((1, 64, 64, 3)))[0]
        for each in (scene, back)
    )
    on = room.screen(64, 64)
    assert seen[on].mean() == pytest.approx(found[on].mean(), rel=0.01)
    assert np.median(np.abs(seen / np.where(found > 0, found, 1) - 1)[on]) < 2e-3


def test_blacks_of_other_projectors_are_not_taken_over(tmp_path: Path, run: Run) -> None:
    """Of other projectors the file does not tell: their black is the mean of those before."""
    scene, path = tmp_path / "cove.toml", tmp_path / "ring.mpcdi"
    scene.write_text(as_toml(dark_cove()))
    path.write_bytes(written_mpcdi(theatre(ring()), (64, 40), "2026-11-25 19:30:11"))
    back = tmp_path / "back.toml"
    assert run("scene", "import", path, "--out", back, "--like", scene)[0] == 0
    assert not load_dome(back).black_differs
    assert load_dome(back).projector.black == pytest.approx(load_dome(scene).projector.black)


def test_it_is_of_the_standards_layout(tmp_path: Path) -> None:
    content = written_mpcdi(theatre(ring(2)), (64, 40), "2026-11-25 19:30:11")
    with zipfile.ZipFile(io.BytesIO(content)) as package:
        assert sorted(package.namelist()) == [
            "alpha1.png", "alpha2.png", "alpha3.png", "mpcdi.xml",
            "warp1.pfm", "warp2.pfm", "warp3.pfm",
        ]  # fmt: skip
        with Image.open(io.BytesIO(package.read("alpha1.png"))) as alpha:
            assert (alpha.size, alpha.mode) == ((64, 40), "I;16")
        warp = package.read("warp1.pfm")
        assert warp.startswith(b"PF\n64 40\n-1.0\n")
        assert len(warp) == len(b"PF\n64 40\n-1.0\n") + 64 * 40 * 12
        text = package.read("mpcdi.xml").decode()
    for wanted in ('profile="sl"', 'version="2.0"', '<region id="P1" xResolution="64"',
                   "<coordinateFrame>", "<leftAngle>", '<fileset region="P1">',
                   "<gammaEmbedded>1.0</gammaEmbedded>", "<geometricUnit>m</"):  # fmt: skip
        assert wanted in text


def test_a_file_whose_dome_stands_elsewhere_is_moved(tmp_path: Path, run: Run) -> None:
    """The file's origin is on the floor; the scene's is the middle of the dome."""
    lens = ring()[0]
    points = landing(Dome(5.0, np.radians(90)), lens, 40, 64) + np.array([0, 0, 2.5])
    forward = lens_frame(lens)[2]
    low, high = np.degrees(np.arctan(field_edges(lens)))
    pitch = np.degrees(np.arcsin(forward[2]))
    yaw = np.degrees(np.arctan2(forward[0], forward[1]))
    frustum = {"leftAngle": low[0], "rightAngle": high[0], "downAngle": low[1],
               "upAngle": high[1], "yaw": yaw, "pitch": pitch}  # fmt: skip
    x, y, z = lens.position
    content = xml(frustum=frustum, position=(x, y, z + 2.5),
                  files=fileset(geometryWarpFile="w.pfm"))  # fmt: skip
    path = package(tmp_path / "x.mpcdi", content, w_pfm=pfm(points * 1000))
    other = tmp_path / "other"
    other.mkdir()
    text = scene_file(other, []).read_text()
    mesh = '[[meshes]]\nname = "chair"\nfile = "chair.obj"\nalbedo = 0.2\n'
    (other / "theatre.toml").write_text(text + mesh)
    (other / "chair.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    result = run(
        "scene", "import", path, "--out", tmp_path / "s.toml", "--like", other / "theatre.toml"
    )
    assert result.code == 0, result
    assert "No blend of one" in result.out
    assert len(load_dome(tmp_path / "s.toml").theatre.solids) == 1
    found = load_dome(tmp_path / "s.toml")
    assert found.dome.radius == pytest.approx(5, rel=1e-4)
    np.testing.assert_allclose(found.theatre.lenses[0].position, lens.position, atol=1e-3)


BAD = {
    "another profile": (xml(frustum={}, profile="2d"), "wanted profile 'sl'"),
    "a fisheye": (xml(frustum={"leftAngle": 89.8, "rightAngle": 89.8}), "A fisheye cannot"),
    "no number": (xml(frustum={}).replace("<yaw>0<", "<yaw>left<"), "'left' for yaw"),
    "crooked axes": (xml(frustum={}, axes={**SURVEYOR, "yaw": (1, 0, 0)}), "at right angles"),
    "no region": ('<MPCDI profile="sl"><display/></MPCDI>', "wanted regions"),
    "a bomb": ('<!DOCTYPE a [<!ENTITY b "c">]><MPCDI profile="sl"/>', "document type"),
    "no XML": ("MPCDI", "does not parse"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_is_told_in_one_line(tmp_path: Path, run: Run, case: str) -> None:
    content, words = BAD[case]
    path = package(tmp_path / "x.mpcdi", content)
    run("scene", "import", path, "--out", tmp_path / "s.toml").is_refused(words)
    assert not (tmp_path / "s.toml").exists()


def refusal(path: Path) -> str:
    try:
        read_mpcdi(path)
    except InputError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("count", [150, pytest.param(1000, marks=pytest.mark.long)])
def test_damaged_files_are_refused_in_one_line(tmp_path: Path, count: int) -> None:
    """The package itself, or a file in it, which then has the right checksum."""
    content = written_mpcdi(theatre(ring(1)), (32, 20), "2026-11-25 19:30:11")
    with zipfile.ZipFile(io.BytesIO(content)) as whole:
        members = {name: whole.read(name) for name in whole.namelist()}
    rng = np.random.default_rng(5)
    messages = []
    for number in range(count):
        path = tmp_path / "x.mpcdi"
        name = str(rng.choice(list(members)))
        damaged = bytearray(content if number % 4 == 0 else members[name])
        for place in rng.integers(len(damaged), size=rng.choice([1, 5, 40])):
            damaged[place] = rng.integers(256)
        cut = bytes(damaged[: rng.integers(len(damaged))] if number % 3 == 0 else damaged)
        if number % 4 == 0:
            path.write_bytes(cut)
        else:
            inner = {key: cut if key == name else value for key, value in members.items()}
            packed(path, inner)
        messages.append(refusal(path))
    assert all("\n" not in each and len(each) < 700 for each in messages)
    refused = [each for each in messages if each]
    assert len(refused) > count / 2
    assert all("x.mpcdi" in each for each in refused)


def test_a_zip_that_unpacks_to_more_than_memory_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("domesim.scene.mpcdi._LARGEST_XML", 1 << 16)
    path = tmp_path / "x.mpcdi"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as made:
        made.writestr("mpcdi.xml", " " * (1 << 17))
    assert "131072 bytes of mpcdi.xml" in refusal(path)


def test_a_theatre_without_projectors_cannot_be_exported(tmp_path: Path, run: Run) -> None:
    run("scene", "export", "dome_hemisphere", "--out", tmp_path / "x.mpcdi").is_refused(
        "no projectors to export"
    )
    lens = Lens("fish", (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), field=3.0)
    run("scene", "export", scene_file(tmp_path, [lens]), "--out", tmp_path / "x").is_refused(
        "'fish' is a fisheye"
    )
