"""Layers and parts of EXRs, written and read again by OpenEXR's own bindings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from command_line import outcome_of

from domesim.errors import InputError
from domesim.frames import Master, read_master, write_master

HEADER = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
ROWS, COLS = 32, 32
BLENDER = [f"ViewLayer.{name}" for name in ("Combined.R", "Combined.G", "Combined.B", "Depth.Z")]
COMPOSITE = [f"Composite.Combined.{end}" for end in "RGBA"]


def planes(*names: str) -> dict[str, np.ndarray]:
    """Channels of values that tell their places."""
    values = np.linspace(0.1, 0.9, ROWS * COLS, dtype=np.float32).reshape(ROWS, COLS)
    return {
        name: np.ones_like(values) if name.endswith("A") else values / (k + 1)
        for k, name in enumerate(names)
    }


def layered(path: Path, *names: str) -> dict[str, np.ndarray]:
    channels = planes(*names)
    OpenEXR.File(dict(HEADER), dict(channels)).write(str(path))
    return channels


def of_parts(path: Path, **names: str) -> list[dict[str, np.ndarray]]:
    """Parts of these names and channels."""
    parts = [planes(*channels.split(",")) for channels in names.values()]
    OpenEXR.File(
        [
            OpenEXR.Part({**HEADER, "name": name}, dict(each))
            for name, each in zip(names, parts, strict=True)
        ]
    ).write(str(path))
    return parts


def read_back(path: Path) -> list[dict[str, np.ndarray]]:
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return [
            {name: np.array(channel.pixels) for name, channel in part.channels.items()}
            for part in file.parts
        ]


def picture(channels: dict[str, np.ndarray], layer: str) -> np.ndarray:
    return np.dstack([channels[f"{layer}{end}"] for end in "RGB"])


@pytest.mark.parametrize("layer", ["ViewLayer.Combined", "Composite.Combined"])
def test_one_of_several_layers_is_chosen_and_others_are_kept(tmp_path: Path, layer: str) -> None:
    channels = layered(tmp_path / "in.exr", *BLENDER, *COMPOSITE)
    master = read_master([tmp_path / "in.exr"], layer=layer)
    np.testing.assert_array_equal(master.frames[0].pixels, picture(channels, f"{layer}."))
    assert f"layer {layer}" in master.described()
    write_master(master.with_pixels(master.pixels / 2), [tmp_path / "out.exr"])
    (found,) = read_back(tmp_path / "out.exr")
    assert set(found) == set(channels)
    for name, plane in channels.items():
        half = name.startswith(layer) and name[-1] in "RGB"
        np.testing.assert_array_equal(found[name], plane / 2 if half else plane)


def test_a_layer_is_chosen_beside_a_picture_without_a_name(tmp_path: Path) -> None:
    channels = layered(tmp_path / "in.exr", "R", "G", "B", "key.R", "key.G", "key.B")
    alone, key = (read_master([tmp_path / "in.exr"], layer=layer) for layer in (None, "key"))
    np.testing.assert_array_equal(alone.frames[0].pixels, picture(channels, ""))
    np.testing.assert_array_equal(key.frames[0].pixels, picture(channels, "key."))


def test_the_only_picture_of_several_parts_is_taken(tmp_path: Path) -> None:
    parts = of_parts(tmp_path / "in.exr", depth="Z", rgba="R,G,B,A")
    master = read_master([tmp_path / "in.exr"])
    np.testing.assert_array_equal(master.frames[0].pixels, picture(parts[1], ""))
    assert "part rgba of 2" in master.described()
    write_master(master.with_pixels(master.pixels / 2), [tmp_path / "out.exr"])
    depth, rgba = read_back(tmp_path / "out.exr")
    np.testing.assert_array_equal(depth["Z"], parts[0]["Z"])
    np.testing.assert_array_equal(picture(rgba, ""), picture(parts[1], "") / 2)
    np.testing.assert_array_equal(rgba["A"], parts[1]["A"])
    write_master(master, [tmp_path / "out.png"])
    assert read_master([tmp_path / "out.png"]).bits == 16


@pytest.mark.parametrize("layer", ["spec", "1"])
def test_a_part_is_chosen_by_name_or_number(tmp_path: Path, layer: str) -> None:
    parts = of_parts(tmp_path / "in.exr", beauty="R,G,B", spec="B,G,R")
    master = read_master([tmp_path / "in.exr"], layer=layer)
    np.testing.assert_array_equal(master.frames[0].pixels, picture(parts[1], ""))


def test_a_layer_within_a_part_is_chosen(tmp_path: Path) -> None:
    parts = of_parts(tmp_path / "in.exr", data="Z", lights="key.R,key.G,key.B,rim.R,rim.G,rim.B")
    master = read_master([tmp_path / "in.exr"], layer="rim")
    np.testing.assert_array_equal(master.frames[0].pixels, picture(parts[1], "rim."))


@pytest.mark.parametrize(
    ("layer", "said"),
    [
        (
            None,
            r"wanted one picture, got a file of several parts \(a, b\).*--layer a, or",
        ),
        ("c", r"wanted one part or layer 'c', got a file of several parts \(a, b\)"),
    ],
)
def test_parts_that_are_not_told_apart_are_named(
    tmp_path: Path, layer: str | None, said: str
) -> None:
    of_parts(tmp_path / "in.exr", a="R,G,B", b="R,G,B")
    with pytest.raises(InputError, match=said):
        read_master([tmp_path / "in.exr"], layer=layer)


def stereo(path: Path) -> dict[str, np.ndarray]:
    """Layers of two views, in one part."""
    ends = [f"{side}{end}" for side in ("", "right.") for end in "RGB"]
    channels = planes(*ends, *(f"key.{name}" for name in ("left.R", "left.G", "left.B")))
    channels |= {f"key.right.{end}": channels[f"right.{end}"] / 3 for end in "RGB"}
    header = {**HEADER, "multiView": ["left", "right"]}
    OpenEXR.File(header, dict(channels)).write(str(path))
    return channels


def test_a_layer_of_both_views_is_chosen(tmp_path: Path) -> None:
    channels = stereo(tmp_path / "in.exr")
    for layer, names in ((None, ("", "right.")), ("key", ("key.left.", "key.right."))):
        master = read_master([tmp_path / "in.exr"], layer=layer)
        for frame, name in zip(master.frames, names, strict=True):
            np.testing.assert_array_equal(frame.pixels, picture(channels, name))
    with pytest.raises(InputError, match=r"wanted layer 'rim' of R, G, B, got .*key"):
        read_master([tmp_path / "in.exr"], layer="rim")


def test_a_layer_of_both_views_parts_is_chosen(tmp_path: Path) -> None:
    sides = {side: planes(*"RGB", "key.R", "key.G", "key.B") for side in ("left", "right")}
    parts = [
        OpenEXR.Part({**HEADER, "name": side, "view": side}, dict(each))
        for side, each in sides.items()
    ]
    OpenEXR.File(parts).write(str(tmp_path / "in.exr"))
    for frame, each in zip(
        read_master([tmp_path / "in.exr"], layer="key", allow_identical=True).frames,
        sides.values(),
        strict=True,
    ):
        np.testing.assert_array_equal(frame.pixels, picture(each, "key."))
    with pytest.raises(InputError, match="wanted one part of view left with layer 'rim'"):
        read_master([tmp_path / "in.exr"], layer="rim", allow_identical=True)


def test_an_mpo_has_no_layers(tmp_path: Path) -> None:
    layered(tmp_path / "in.exr", "R", "G", "B")
    frame = read_master([tmp_path / "in.exr"]).frames[0]
    write_master(Master((frame, frame.with_pixels(frame.pixels / 2)), "mpo"), [tmp_path / "x.mpo"])
    assert read_master([tmp_path / "x.mpo"]).packing == "mpo"
    with pytest.raises(InputError, match="wanted layer 'key', got JPEG"):
        read_master([tmp_path / "x.mpo"], layer="key")


def test_what_has_no_layers_is_not_searched_for_one(tmp_path: Path) -> None:
    layered(tmp_path / "in.exr", "R", "G", "B")
    write_master(read_master([tmp_path / "in.exr"]), [tmp_path / "in.png"])
    for name, got in (("in.exr", "no layers"), ("in.png", "PNG, which has none")):
        with pytest.raises(InputError, match=f"wanted layer 'key'.*got {got}"):
            read_master([tmp_path / name], layer="key")


def test_commands_compensate_a_layer_and_keep_others(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    channels = layered(tmp_path / "in.exr", *BLENDER, *COMPOSITE)
    arguments = ("compensate", tmp_path / "in.exr", "--scene", "dome_planetarium")
    out = tmp_path / "out"
    refused = outcome_of(capfd, *arguments, "--out", out)
    assert refused.code == 2
    assert "--layer Composite.Combined" in refused.err
    done = outcome_of(capfd, *arguments, "--out", out, "--layer", "ViewLayer.Combined")
    assert done.code == 0, done.err
    (found,) = read_back(out / "in.exr")
    assert np.ptp(found["ViewLayer.Combined.R"] - channels["ViewLayer.Combined.R"]) > 0.001
    np.testing.assert_array_equal(found["ViewLayer.Depth.Z"], channels["ViewLayer.Depth.Z"])
    np.testing.assert_array_equal(found["Composite.Combined.R"], channels["Composite.Combined.R"])
