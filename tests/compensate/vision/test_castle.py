"""castleCSF: its formula by hand, a table of the authors' own, and measured thresholds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from compensate.vision.castle import (
    ACHROMATIC,
    COLORVIDEOVDP,
    DKL_FROM_LMS,
    DKL_FROM_XYZ,
    LMS_FROM_XYZ,
    MECHANISMS,
    RED_GREEN,
    YELLOW_VIOLET,
    castle,
    opponent_contrast,
)
from domesim.errors import InputError


def by_hand(f, s_max, f_max, bw, least, a_0, f_0, area):
    """The model at one point with `math` alone, in another order than the code's."""
    falloff = 10 ** (-((math.log(f / f_max) / math.log(10)) ** 2) / 2**bw)
    if f < f_max:
        falloff = max(falloff, least)
    inverse_area = (1 + (f / f_0) ** 2) / a_0 + 1 / area
    return s_max * falloff * f / math.sqrt(inverse_area)


@pytest.mark.parametrize("luminance", [0.03, 5.0, 900.0])
@pytest.mark.parametrize(("frequency", "area"), [(0.2, 50.0), (3.0, 1.5), (17.0, 0.4)])
def test_the_formula_by_hand(frequency, luminance, area):
    bright = 1 - math.exp(-9.66862e9 * math.log1p(5.58341e-7 / luminance))
    expected = {
        ACHROMATIC: by_hand(
            frequency,
            56.4947 * bright / (1 + 7.54726 / luminance) ** 0.144532,
            1.78119 / (1 + 91.5718 / luminance) ** 0.256682,
            0.000213047,
            0.899793,
            157.103,
            0.702338,
            area,
        ),
        RED_GREEN: by_hand(
            frequency,
            681.434 / (1 + 38.0038 / luminance) ** 0.480386,
            0.0178364,
            2.42104,
            1,
            2816.44,
            0.0711058,
            area,
        ),
        YELLOW_VIOLET: by_hand(
            frequency,
            166.683 / (1 + 62.8974 / luminance) ** 0.41193,
            0.00425753,
            2.68197,
            1,
            2.82789e7,
            0.000635093,
            area,
        ),
    }
    for mechanism, value in expected.items():
        assert castle(frequency, luminance, mechanism, area=area) == pytest.approx(value, rel=1e-9)


# ColorVideoVDP 0.5 (github.com/gfxdisp/ColorVideoVDP), vvdp_data/csf_lut_weber_fixed_size.json:
# log10 S at 0 Hz for a Gaussian window of sigma 1.5°, computed by castleCSF's authors with another
# calibration of the same formula, which is not published. `COLORVIDEOVDP` holds it as fitted to
# the table where S > 1 (897 of 1024 entries achromatic, 988 red-green, 926 yellow-violet): log10 S
# is met to 2e-5 (achromatic, 12 numbers) and 2e-15 (colours, 7 numbers), and most of the colours'
# numbers come out with six digits, as the authors write them. So the table is of this formula.
TABLE_FREQUENCY = [0.15172036166614578, 0.8039320566914592, 4.259855069409406, 22.572013469712154]
TABLE_LUMINANCE = [8.935410686953832, 377.73460670691384]
TABLE = {
    "achromatic": [
        [1.2455556838988981, 1.9939802595917049, 2.2204630446962, 0.9602940725687318],
        [1.380368624546178, 2.096531242753036, 2.531204231358722, 1.5183391233682324],
    ],
    "red-green": [
        [2.0756336514222364, 2.267884567065598, 1.9813091582423445, 1.2891626339492117],
        [2.4011071032812636, 2.5933580189246253, 2.3067826101013718, 1.6146360858082387],
    ],
    "yellow-violet": [
        [1.4007510810985762, 1.6232906810962404, 1.30525887692165, 0.615625415407674],
        [1.7426046685754262, 1.9651442685730907, 1.6471124643985, 0.9574790028845241],
    ],
}
OLDER = dict(zip(TABLE, COLORVIDEOVDP, strict=True))


@pytest.mark.parametrize("name", TABLE)
def test_the_formula_is_that_of_the_authors_table(name):
    luminance = np.array(TABLE_LUMINANCE)[:, None]
    ours = castle(TABLE_FREQUENCY, luminance, OLDER[name], area=math.pi * 1.5**2)
    tolerance = 1e-5 if name == "achromatic" else 1e-9
    np.testing.assert_allclose(ours, 10 ** np.array(TABLE[name]), rtol=tolerance)


# Measured thresholds, data/data_aggregated.csv of github.com/gfxdisp/castleCSF, data set hdr_csf
# (Wuerger et al. 2020), means of 7 to 21 observers: frequency, colour direction, area, sensitivity
# (1 / length of cone contrast x sqrt 3). Backgrounds 5 and 7, directions 9 to 11.
BACKGROUND = {
    2: [1.37372382067036, 0.626276179329636, 0.0477574242276299],
    200: [137.372382067036, 62.6276179329636, 4.77574242276299],
}
DIRECTION = {
    9: [0.904788433511642, 0.419896446537257, 0.0710272114680906],
    10: [0.762860488743917, -0.646494144848118, -0.00944433112997181],
    11: [0.450449715432405, 0.274890824273731, 0.84942927227461],
}
MEASURED = {
    2: [
        (0.5, 9, 3.14159265358979, 27.6705076170798),
        (0.5, 10, 3.14159265358979, 139.42895110673),
        (0.5, 11, 3.14159265358979, 17.4974154297071),
        (1, 9, 0.785398163397448, 37.3474486034849),
        (1, 10, 0.785398163397448, 88.3482685154401),
        (1, 11, 0.785398163397448, 8.84530250579611),
        (2, 9, 0.196349540849362, 29.4247742496509),
        (2, 10, 0.196349540849362, 36.3336036127889),
        (2, 11, 0.196349540849362, 5.79127442997019),
        (4, 9, 0.0490873852123405, 11.250271982033),
        (4, 10, 0.0490873852123405, 16.1848950124728),
        (4, 11, 0.0490873852123405, 4.1184267224974),
        (6, 9, 0.0218166156499291, 4.64598928977493),
        (6, 10, 0.0218166156499291, 11.3397583205273),
        (6, 11, 0.0218166156499291, 2.34706655465675),
    ],
    200: [
        (0.5, 9, 3.14159265358979, 24.1436147961198),
        (0.5, 10, 3.14159265358979, 515.316863338208),
        (0.5, 11, 3.14159265358979, 63.0191321508327),
        (1, 9, 0.785398163397448, 41.6614082542299),
        (1, 10, 0.785398163397448, 365.797861090072),
        (1, 11, 0.785398163397448, 39.3249985984381),
        (2, 9, 0.196349540849362, 51.2898107442816),
        (2, 10, 0.196349540849362, 189.478890290403),
        (2, 11, 0.196349540849362, 18.2286123987884),
        (4, 9, 0.0490873852123405, 33.4643392246779),
        (4, 10, 0.0490873852123405, 68.8960748601535),
        (4, 11, 0.0490873852123405, 12.5563731036491),
        (6, 9, 0.0218166156499291, 18.3237288493412),
        (6, 10, 0.0218166156499291, 38.6251383435235),
        (6, 11, 0.0218166156499291, 8.89284844207084),
    ],
}


def errors_in_decibels(direction, mechanisms=MECHANISMS):
    return np.concatenate(
        [
            errors_of(
                luminance,
                BACKGROUND[luminance],
                DIRECTION[direction],
                [(f, area, s) for f, measured, area, s in rows if measured == direction],
                mechanisms,
            )
            for luminance, rows in MEASURED.items()
        ]
    )


def errors_of(luminance, background, delta, rows, mechanisms):
    """Of (frequency, area, sensitivity): predicted over measured sensitivity, dB."""
    background, delta = np.array(background), np.array(delta)
    contrast = DKL_FROM_LMS @ delta / (DKL_FROM_LMS[0] @ background)
    cone_contrast = np.linalg.norm(delta / background) / math.sqrt(3)
    errors = []
    for frequency, area, sensitivity in rows:
        S = [float(castle(frequency, luminance, m, area=area)) for m in mechanisms]
        seen = np.linalg.norm(S * contrast)  # 1 at threshold
        errors.append(20 * math.log10(seen / cone_contrast / sensitivity))
    return np.array(errors)


# The same file's other sets along yellow-violet: colorfest (Wuerger, Watson, Ahumada 2002),
# direction 4, background 2, and kim2013, direction 18, backgrounds 13 and 14. (Above 8 c/deg
# colorfest's sensitivity rises again: not by colour.)
YELLOW_VIOLET_ELSEWHERE = {
    "colorfest, 40 cd/m²": (
        40,
        [27.4744764134073, 12.5255235865927, 0.955148484552597],
        [0.450449715432406, 0.274890824273731, 0.84942927227461],
        [
            (1.2, 0.785398163397448, 43.7450664921267),
            (2, 0.785398163397448, 27.2126246376197),
            (2.8, 0.785398163397448, 18.189235591246),
            (4, 0.785398163397448, 17.0827569501792),
            (5.66, 0.785398163397448, 12.1552663918457),
            (8, 0.785398163397448, 8.03196114411758),
        ],
    ),
    "kim2013, 2 cd/m²": (
        2,
        [1.39814630585742, 0.601853694142584, 0.0396184365436043],
        [0.523090228316175, 0.249070792289613, 0.815070765926712],
        [
            (0.25, 28.2743338823081, 41.1039236727635),
            (0.5, 7.06858347057703, 32.108075865721),
            (1, 7.06858347057703, 23.3528786900825),
            (2, 7.06858347057703, 11.0694997488745),
            (4, 7.06858347057703, 5.3190490443116),
        ],
    ),
    "kim2013, 40 cd/m²": (
        40,
        [27.9629261171483, 12.0370738828517, 0.792368730872086],
        [0.523090228316175, 0.249070792289613, 0.815070765926712],
        [
            (0.25, 28.2743338823081, 84.3408389778098),
            (0.5, 7.06858347057703, 82.6765164275221),
            (1, 7.06858347057703, 70.5494740585683),
            (2, 7.06858347057703, 32.1501630996639),
        ],
    ),
}


def test_yellow_violet_is_as_measured_and_not_as_colorvideovdps_table():
    """``validation/notes/0012``: by the authors' own thresholds, of three laboratories."""
    table = tuple(OLDER.values())
    names = [*YELLOW_VIOLET_ELSEWHERE, "hdr_csf"]
    ours, theirs = (
        [
            *(errors_of(*each, mechanisms).mean() for each in YELLOW_VIOLET_ELSEWHERE.values()),
            errors_in_decibels(11, mechanisms).mean(),
        ]
        for mechanisms in (MECHANISMS, table)
    )
    for name, mine, its in zip(names, ours, theirs, strict=True):
        assert abs(mine) < 2.5, name
        assert its > 5, name
    assert abs(np.mean(ours)) < 1


def test_measured_thresholds_lie_within_the_models_stated_error():
    """The authors state 3.75 dB for hdr_csf, with no correction of its level.

    www.cl.cam.ac.uk/research/rainbow/projects/castleCSF/html_reports/comparison-5 (frequency,
    luminance, area, colour).
    """
    errors = np.concatenate([errors_in_decibels(direction) for direction in DIRECTION])
    assert errors.size == 30
    assert np.sqrt(np.mean(errors**2)) < 3.75


@pytest.mark.parametrize("direction", DIRECTION)
def test_no_mechanism_is_off_by_a_factor(direction):
    """3.75 dB over the root of 10 points is 1.2 dB: 4 dB is more than three of them."""
    assert abs(errors_in_decibels(direction).mean()) < 4


def test_d65_is_seen_by_the_achromatic_mechanism_alone():
    white = [0.95047, 1.0, 1.08883]
    response = DKL_FROM_XYZ @ white
    assert response[0] == pytest.approx(1, abs=0.06)  # CIE 2006 against CIE 1931 luminance
    assert np.abs(response[1:]).max() < 0.02
    np.testing.assert_allclose(opponent_contrast(white, white), response / response[0], rtol=1e-12)


def test_the_cone_matrix_inverts_the_authors_own_inverse():
    """M_lms2006_xyz of lms2006_2xyz.m."""
    inverse = [
        [2.629129278399650, -3.780202391780134, 10.294956387893450],
        [0.865649062438827, 1.215555811642301, -0.984175688105352],
        [-0.008886561474676, 0.081612628990755, 51.371024830897888],
    ]
    np.testing.assert_allclose(LMS_FROM_XYZ @ inverse, np.eye(3), atol=1e-13)


def test_opponent_contrast_keeps_its_sign_and_takes_pictures():
    background = np.array([30.0, 40.0, 50.0])
    red, violet = [1.0, 0.3, 0.0], [0.2, 0.0, 1.0]
    picture = np.array([[red, violet], [np.negative(red), np.zeros(3)]])
    contrast = opponent_contrast(picture, background)
    assert contrast.shape == (2, 2, 3)
    assert contrast[0, 0, 1] > 0  # more red
    assert contrast[0, 1, 2] > 0  # more violet
    np.testing.assert_allclose(contrast[1, 0], -contrast[0, 0], rtol=1e-12)
    np.testing.assert_array_equal(contrast[1, 1], 0)
    # another unit of light, the same contrast
    np.testing.assert_allclose(opponent_contrast(7 * picture, 7 * background), contrast, rtol=1e-12)


@pytest.mark.parametrize("mechanism", MECHANISMS)
def test_shapes_and_zero_frequency(mechanism):
    sensitivity = castle([0.0, 1.0, 4.0], [[0.1], [10.0]], mechanism, area=2.0)
    assert sensitivity.shape == (2, 3)
    np.testing.assert_array_equal(sensitivity[:, 0], 0)
    assert (sensitivity[:, 1:] > 0).all()
    assert castle(1e4, 10.0, mechanism, area=2.0) < 1e-3


@pytest.mark.parametrize("mechanism", MECHANISMS)
def test_a_larger_grating_is_seen_better_up_to_the_critical_area(mechanism):
    small, large = (castle(2.0, 20.0, mechanism, area=area) for area in (1e-9, 4e-9))
    assert large / small == pytest.approx(2, rel=1e-6)  # ideal summation: the root of the area
    wide, wider = (castle(2.0, 20.0, mechanism, area=area) for area in (1e9, 4e9))
    assert wider / wide == pytest.approx(1, rel=1e-5)


def test_sensitivity_is_smooth_in_the_dark():
    """The reference's transient tail would make it jump about 0.0113 cd/m²."""
    luminance = np.geomspace(0.009, 0.014, 400)
    sensitivity = castle(8.0, luminance, ACHROMATIC, area=1.0)
    assert (np.diff(sensitivity) > 0).all()
    assert np.diff(np.log(sensitivity)).max() < 0.01


@pytest.mark.parametrize("mechanism", MECHANISMS)
def test_conditions_that_cannot_be_are_refused(mechanism):
    for area in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(InputError, match="area above 0"):
            castle(1.0, 1.0, mechanism, area=area)
    for frequency in (-1.0, math.nan):
        with pytest.raises(InputError, match="frequencies of at least 0"):
            castle([1.0, frequency], 1.0, mechanism, area=1.0)
    for luminance in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(InputError, match="luminances above 0"):
            castle(1.0, [1.0, luminance], mechanism, area=1.0)
    with pytest.raises(InputError, match=r"difference takes the axes \(\*s 3\), got \(2,\)"):
        opponent_contrast([1.0, 2.0], [1.0, 1.0, 1.0])
    for background in ([0.0, 0.0, 0.0], [math.nan, 1.0, 1.0]):
        with pytest.raises(InputError, match="brighter than black"):
            opponent_contrast([1.0, 2.0, 3.0], background)
