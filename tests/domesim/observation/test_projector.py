"""Projector and viewing: colour in and out, and angles that a published figure checks."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from domesim.errors import InputError
from domesim.light.transfer import SRGB, Linear
from domesim.observation.projector import CINEMA, PRIMARIES, Projector, conversion
from domesim.room.dome import Dome
from domesim.room.viewing import Viewing, from_dome_centre, of_flat_screen


@pytest.mark.parametrize("source", PRIMARIES)
@pytest.mark.parametrize("target", [name for name in PRIMARIES if name != "XYZ"])
def test_decode_and_encode_are_inverses(source, target):
    projector = Projector(target, white=48.0)
    pixels = np.random.default_rng(0).random((2, 5, 7, 3), np.float32)
    light = projector.decode(pixels, SRGB(), source)
    assert light.shape == (2, 5, 7, 3)
    assert light.dtype == np.float32
    assert projector.encode(light, SRGB(), source) == pytest.approx(pixels, abs=2e-5)


def test_luminance_weights_are_those_of_the_standard():
    assert Projector("BT.709", 1.0).luminance_weights == pytest.approx(
        [0.2126, 0.7152, 0.0722], abs=1e-4
    )
    # ITU-R BT.2020 table 4: Y' = 0.2627 R' + 0.6780 G' + 0.0593 B'
    assert Projector("BT.2020", 1.0).luminance_weights == pytest.approx(
        [0.2627, 0.6780, 0.0593], abs=1e-4
    )


NAMES = {
    "BT.709": "ITU-R BT.709",
    "BT.2020": "ITU-R BT.2020",
    "P3-D65": "P3-D65",
    "P3-DCI": "DCI-P3",
    "Adobe RGB": "Adobe RGB (1998)",
    "ACES AP0": "ACES2065-1",
    "ACES AP1": "ACEScg",
}


def test_conversions_are_those_of_colour_science():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour  # noqa: PLC0415
    spaces = {name: colour.RGB_COLOURSPACES[known] for name, known in NAMES.items()}
    assert set(spaces) | {"XYZ"} == set(PRIMARIES)
    for name, space in spaces.items():
        # AP0's matrix was published with ten digits
        # and Adobe RGB's with five
        near = 2e-5 if name == "Adobe RGB" else 1e-9
        assert conversion(name, "XYZ") == pytest.approx(space.matrix_RGB_to_XYZ, abs=near)
        assert conversion("XYZ", name) == pytest.approx(space.matrix_XYZ_to_RGB, abs=near)
        for other, target in spaces.items():
            expected = colour.matrix_RGB_to_RGB(space, target, "Bradford")
            near = 2e-5 if "Adobe RGB" in (name, other) else 1e-9
            assert conversion(name, other) == pytest.approx(expected, abs=near)


@pytest.mark.parametrize("name", ["Adobe RGB (1998)", "prophoto rgb", "NTSC (1953)"])
def test_a_projector_has_the_primaries_of_any_space_of_colour_science(name):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour  # noqa: PLC0415
    space = colour.RGB_COLOURSPACES[name]
    expected = colour.normalised_primary_matrix(space.primaries, space.whitepoint)
    assert Projector(name, 30.0).to_xyz == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("name", ["sYCC", "DCDM XYZ"])
def test_primaries_that_nobody_knows_or_no_light_has_are_refused(name):
    with pytest.raises(InputError, match=f"{name}' are not known; use one of BT.709, .*Adobe RGB"):
        Projector(name, 30.0)


def test_a_wide_gamut_colour_leaves_the_range_and_is_not_clamped():
    green = np.array([[[0.0, 1.0, 0.0]]])
    light = Projector("BT.709", 10.0).decode(green, Linear(), "BT.2020")
    assert light.min() < -0.1
    assert light.max() > 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("XYZ", 10.0), "real lights"),
        (("BT.709", 0.0), "white must be above 0"),
        (("BT.709", 10.0, 10.0), "below white"),
        (("BT.709", 10.0, -1.0), "below white"),
    ],
)
def test_impossible_projectors_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        Projector(*arguments)


def test_the_papers_screen_has_the_papers_angles():
    viewing = of_flat_screen(2.5, 2.5 * 9 / 16, 3.0, adaptation=5.0)
    assert viewing.image_area == pytest.approx(1282.28, abs=0.1)
    assert viewing.pixels_per_degree(720, 1280) == pytest.approx(1280 / np.degrees(2.5 / 3))


def test_a_hemisphere_is_180_degrees_and_half_of_the_sphere():
    viewing = from_dome_centre(Dome(10.0, np.pi / 2), adaptation=1.0)
    assert viewing.pixels_per_degree(4096, 4096) == pytest.approx(4096 / 180)
    assert viewing.image_area == pytest.approx(41252.96 / 2, abs=0.01)  # deg² in a sphere
    assert viewing.distance == 10.0


@pytest.mark.parametrize("name", ["extent", "image_area", "distance", "adaptation"])
def test_impossible_viewing_is_refused(name):
    values = {"extent": 1.0, "image_area": 1.0, "distance": 1.0, "adaptation": 1.0, name: 0.0}
    with pytest.raises(InputError, match=f"viewing {name} must be above 0"):
        Viewing(**values)


def test_the_same_primaries_change_nothing():
    pixels = np.random.default_rng(0).random((2, 5, 7, 3), np.float32)
    assert (Projector("BT.709", 10.0).decode(pixels, Linear(), "BT.709") == pixels).all()


@pytest.mark.parametrize("source", [name for name in PRIMARIES if name not in CINEMA])
def test_white_stays_white(source):
    white = np.ones((1, 1, 3))
    assert Projector("BT.709", 10.0).decode(white, Linear(), source) == pytest.approx(1, abs=1e-4)


def test_xyz_is_colorimetric():
    assert conversion("BT.709", "XYZ")[1] == pytest.approx([0.2126, 0.7152, 0.0722], abs=1e-4)
