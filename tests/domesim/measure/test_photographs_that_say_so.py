"""Photographs of a dome that say themselves that they are not linear."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from icc_profiles import SRGB_CURVE, icc_profile, linear
from image_files import store

from domesim.errors import InputError
from domesim.measure.dome.file import CameraSection, _light, read_survey

CAMERA = CameraSection(mapping="domemaster")


def photograph(path: Path, **said: object) -> Path:
    return store(path, np.full((8, 8, 3), 20000, np.uint16), **said)


def test_a_photograph_with_a_curve_is_refused_at_once(tmp_path: Path) -> None:
    for name, curve in (("linear.tif", linear()), ("curved.tif", SRGB_CURVE)):
        profile = icc_profile("made", "BT.709", curve)
        path = photograph(tmp_path / name, ICCProfile=(f"uint8[{profile.size}]", profile))
        if name == "linear.tif":
            assert _light(path, CAMERA)[0][0, 0] == pytest.approx(20000 / 65535)
        else:
            with pytest.raises(InputError, match=r"wanted a linear photograph, got sRGB"):
                _light(path, CAMERA)
    assert _light(photograph(tmp_path / "silent.tif"), CAMERA)[0].shape == (8, 8, 3)


def test_it_is_told_before_patterns_are_read(tmp_path: Path) -> None:
    profile = icc_profile("made", "BT.709", SRGB_CURVE)
    photograph(tmp_path / "curved.tif", ICCProfile=(f"uint8[{profile.size}]", profile))
    (tmp_path / "survey.toml").write_text(
        'theatre = "dome_hemisphere"\n[camera]\nmapping = "domemaster"\n'
        '[[photographs]]\nfile = "curved.tif"\npattern = "none.exr"\n'
    )
    with pytest.raises(InputError, match=r"curved.tif: wanted a linear photograph, got sRGB"):
        read_survey(tmp_path / "survey.toml")
