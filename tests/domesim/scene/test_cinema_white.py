"""A film in P3 of DCI and the same light in X'Y'Z' are one light, and make one DCDM."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command_line import Run
from image_files import store

from domesim.frames import read_frame
from domesim.frames.encodings import encoding_named
from domesim.light import transfer
from domesim.observation.projector import Projector


@pytest.mark.parametrize("grey", [0.9, 0.5])
def test_both_make_the_same_dcdm(tmp_path: Path, out: Path, run: Run, grey: float) -> None:
    """Greys of white of 48 cd/m²; codes as RP 431-2 has them. The scene's own white is D65."""
    codes = np.full((64, 128, 3), round(grey * 65535), np.uint16)
    light = np.array([3794, 3960, 3890]) * grey  # of RP 431-2, table A.1
    store(tmp_path / "rgb.tif", codes)
    store(tmp_path / "xyz.tif", np.full((64, 128, 3), np.rint(light) * 16, np.uint16))
    for name, encoding in (("rgb", "p3-dci"), ("xyz", "dcdm")):
        outcome = run(
            *("compensate", tmp_path / f"{name}.tif", "--scene", "cinema_2d", "--out", out),
            *("--method", "none", "--encoding", encoding, "--output-encoding", "dcdm"),
        )
        assert ("its white kept" in outcome.out) == (encoding == "p3-dci")
        made = read_frame(out / f"{name}.tif", colour=encoding_named("dcdm")).pixels[32, 64]
        np.testing.assert_allclose(made * 4095, light, atol=1.01)


@pytest.mark.parametrize("primaries", ["P3-D65", "P3-DCI", "BT.2020"])
def test_there_and_back(primaries: str) -> None:
    projector = Projector(primaries, 48.0)
    curve = transfer.named("gamma2.6", white=48.0)
    codes = np.random.default_rng(4).random((1, 8, 8, 3))
    there = projector.decode(codes, curve, "P3-DCI")
    np.testing.assert_allclose(projector.encode(there, curve, "P3-DCI"), codes, atol=1e-6)
    white = projector.decode(np.ones((1, 1, 1, 3)), curve, "P3-DCI")[0, 0, 0]
    x, y, z = projector.to_xyz @ white
    assert (x / (x + y + z), y / (x + y + z)) == pytest.approx((0.314, 0.351), abs=1e-6)
    for relative in ("P3-D65", "BT.709"):
        shown = projector.decode(np.ones((1, 1, 1, 3)), curve, relative)
        np.testing.assert_allclose(shown, 1, atol=1e-6)
