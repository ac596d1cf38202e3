"""Spaces of OpenColorIO: codes and light are those of its own processors."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from command_line import Run
from image_files import store

from domesim.errors import InputError
from domesim.frames import read_frame
from domesim.frames.encodings import encoding_named
from domesim.light import ocio
from domesim.light.transfer import named
from domesim.observation.projector import Projector

library = pytest.importorskip("PyOpenColorIO")

SPACES = ["ACEScct", "ACEScg", "acescc", "sRGB - Display", "Gamma 2.6 P3-D65 - Display"]
LINEAR = "Linear Rec.709 (sRGB)"
OWN = """ocio_profile_version: 2.1
search_path: .
roles: {default: plain, scene_linear: plain, aces_interchange: ap0}
file_rules: [!<Rule> {name: Default, colorspace: plain}]
displays: {mine: [!<View> {name: Raw, colorspace: plain}]}
colorspaces:
  - !<ColorSpace> {name: ap0}
  - !<ColorSpace>
    name: plain
    to_scene_reference: !<MatrixTransform> {matrix: [0.6954522414, 0.1406786965, 0.1638690622, 0, 0.0447945634, 0.8596711185, 0.0955343182, 0, -0.0055258826, 0.0040252103, 1.0015006723, 0, 0, 0, 0, 1]}
  - !<ColorSpace>
    name: looked up
    to_scene_reference: !<FileTransform> {src: table.spi1d}
  - !<ColorSpace>
    name: one way
    to_scene_reference: !<MatrixTransform> {matrix: [1, 1, 1, 0, 1, 1, 1, 0, 1, 1, 1, 0, 0, 0, 0, 1]}
"""  # noqa: E501


@pytest.fixture(autouse=True)
def config(monkeypatch: pytest.MonkeyPatch) -> object:
    monkeypatch.setenv("OCIO", "ocio://cg-config-latest")
    return library.Config.CreateFromFile("ocio://cg-config-latest")


def by_its_own(config: object, source: str, target: str, values: np.ndarray) -> np.ndarray:
    result = np.array(values, np.float32)
    processor = config.getProcessor(source, target)  # type: ignore[attr-defined]
    processor.getOptimizedCPUProcessor(library.OPTIMIZATION_LOSSLESS).applyRGB(result)
    return result


def own_config(folder: Path, exponent: float = 2.0) -> Path:
    values = np.linspace(0, 1, 512) ** exponent
    table = "\n".join(f"{value:.9f}" for value in values)
    (folder / "table.spi1d").write_text(
        f"Version 1\nFrom 0 1\nLength {len(values)}\nComponents 1\n{{\n{table}\n}}\n"
    )
    (folder / "config.ocio").write_text(OWN)
    return folder / "config.ocio"


@pytest.mark.parametrize("space", SPACES)
def test_light_is_what_its_own_processor_gives(config: object, space: str) -> None:
    codes = np.random.default_rng(0).uniform(0.3, 0.6, (1, 5, 7, 3)).astype(np.float32)
    colour = encoding_named(f"ocio:{space}")
    curve = named(colour.transfer, white=300.0)
    expected = by_its_own(config, space, LINEAR, codes)
    light = Projector("BT.709", 300.0).decode(codes, curve, colour.primaries)
    np.testing.assert_allclose(light, expected, rtol=2e-5, atol=2e-5 * expected.max())
    back = Projector("BT.709", 300.0).encode(light, curve, colour.primaries)
    np.testing.assert_allclose(back, codes, atol=2e-5)


def test_codes_of_ten_bits_come_back() -> None:
    codes = np.repeat(np.arange(1024)[:, None], 3, axis=1).astype(np.float32) / 1023
    curve = named(encoding_named("ocio:Rec.1886 Rec.709 - Display").transfer, white=100.0)
    np.testing.assert_array_equal(np.rint(curve.encode(curve.decode(codes)) * 1023), codes * 1023)


def test_a_configuration_of_ones_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OCIO", str(own_config(tmp_path)))
    colour = encoding_named("ocio:Looked Up")
    assert colour.named == "OCIO 'looked up'"
    codes = np.float32([[0.5, 0.25, 1.0]])
    curve = named(colour.transfer, white=100.0)
    np.testing.assert_allclose(curve.decode(codes), codes**2, atol=2e-6)
    np.testing.assert_allclose(curve.encode(codes**2), codes, atol=2e-6)
    with pytest.raises(InputError, match=r"one way.*converted to ACES2065-1 and back"):
        encoding_named("ocio:one way")


def test_another_configuration_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As it may lie on another machine, under the same name."""
    for folder, exponent in (("a", 2.0), ("b", 2.1)):
        (tmp_path / folder).mkdir()
        own_config(tmp_path / folder, exponent)
    monkeypatch.setenv("OCIO", str(tmp_path / "a" / "config.ocio"))
    colour = encoding_named("ocio:looked up")
    monkeypatch.setenv("OCIO", str(tmp_path / "b" / "config.ocio"))
    assert encoding_named("ocio:looked up").transfer != colour.transfer
    ocio.space_called.cache_clear()
    with pytest.raises(InputError, match="wanted the conversion that the command began with"):
        named(colour.transfer, white=100.0).decode(np.ones((1, 3), np.float32))


def test_the_command_reads_and_writes_them(
    config: object, tmp_path: Path, out: Path, run: Run
) -> None:
    light = np.random.default_rng(1).uniform(0.05, 0.9, (64, 64, 3)).astype(np.float32)
    codes = by_its_own(config, LINEAR, "ACEScct", light)
    store(tmp_path / "cct.exr", codes)
    store(tmp_path / "light.exr", light)
    scene = ("--scene", "dome_hemisphere", "--method", "none", "--out", out)
    result = run("compensate", tmp_path / "cct.exr", "--encoding", "ocio:acescct", *scene)
    assert result.code == 0, result
    assert "OCIO 'ACEScct' (--encoding ocio:acescct)" in result.out
    stored = read_frame(out / "cct.exr").pixels
    np.testing.assert_allclose(stored, codes, atol=1e-5)
    made = run("compensate", tmp_path / "light.exr", "--output-encoding", "ocio:ACEScct", *scene)
    assert made.code == 0, made
    assert "OCIO 'ACEScct', which the file cannot say" in made.out
    stored = read_frame(out / "light.exr").pixels
    on = np.hypot(*(np.mgrid[:64, :64] - 31.5)) < 31
    np.testing.assert_allclose(stored[on], codes[on], atol=1e-4)


@pytest.mark.parametrize(
    ("place", "space", "words"),
    [
        ("", "ACEScg", r"set \$OCIO: a file, or ocio://cg-config-latest"),
        ("ocio://cg-config-latest", "ACESxyz", r"no such space of colours; use one of: .*ACEScct"),
        ("ocio://cg-config-latest", "Raw", "no such space of colours"),
        ("ocio://no-config", "ACEScg", r"wanted a configuration of OpenColorIO in \$OCIO"),
        ("no such file", "ACEScg", r"wanted a configuration of OpenColorIO in \$OCIO"),
    ],
)
def test_what_is_missing_is_named(
    monkeypatch: pytest.MonkeyPatch, place: str, space: str, words: str
) -> None:
    monkeypatch.setenv("OCIO", place)
    with pytest.raises(InputError, match=words) as caught:
        encoding_named(f"ocio:{space}")
    assert "\n" not in str(caught.value)


def test_without_the_library_its_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "PyOpenColorIO", None)
    with pytest.raises(InputError, match="extra 'ocio'"):
        encoding_named("ocio:ACEScg")
