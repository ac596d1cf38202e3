"""Transfer functions: exact inverses at every code, and colour-science as an independent oracle."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from domesim.errors import InputError
from domesim.light.transfer import (
    DCDM,
    HLG,
    SRGB,
    ST2084,
    Gamma,
    Linear,
    MeasuredTable,
    Transfer,
    named,
)

LEVELS = np.linspace(0, 1, 30)
TABLE = MeasuredTable(LEVELS, np.stack([LEVELS**2.1, LEVELS**2.4, LEVELS**2.7], -1))
CURVES = [
    Linear(),
    Gamma(2.2),
    Gamma(2.4),
    Gamma(2.6),
    SRGB(),
    ST2084(48.0),
    ST2084(1000.0),
    DCDM(),
    HLG(1000.0),
    HLG(48.0),
    TABLE,
]


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
@pytest.mark.parametrize("curve", CURVES, ids=repr)
def test_a_round_trip_returns_every_code(curve, bits):
    top = 2**bits - 1
    codes = np.arange(top + 1)
    values = np.repeat((codes / top).astype(np.float32)[:, None], 3, axis=1)
    light = curve.decode(values)
    assert light.dtype == np.float32
    assert np.abs(curve.encode(light) * top - codes[:, None]).max() < 0.5
    # Every curve rises; ST 2084's lowest codes at 16 bit are all black.
    assert (np.diff(light[:, 0]) >= 0).all()


@pytest.fixture(scope="module")
def colour():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour  # noqa: PLC0415
    return colour


def test_curves_agree_with_colour_science(colour):
    code = np.linspace(0, 1, 4001)
    assert SRGB().decode(code) == pytest.approx(colour.cctf_decoding(code, "sRGB"), abs=1e-12)
    absolute = colour.models.eotf_ST2084(code)
    assert ST2084(48.0).decode(code) * 48 == pytest.approx(absolute, rel=1e-9, abs=1e-9)
    cinema = colour.models.eotf_DCDM(code)
    assert DCDM().decode(code) * 48 == pytest.approx(cinema, rel=1e-9)


@pytest.mark.parametrize("peak", [400.0, 1000.0, 2000.0])
def test_hlg_agrees_with_colour_science(colour, peak):
    """Of colours, not of greys alone: the OOTF goes by their luminance."""
    codes = np.random.default_rng(3).random((500, 3))
    codes[:2] = [[1, 1, 1], [0, 0.5, 0]]
    shown = colour.models.eotf_BT2100_HLG(codes, L_B=0, L_W=peak, method="ITU-R BT.2100-2")
    np.testing.assert_allclose(HLG(peak).decode(codes) * peak, shown, rtol=1e-6, atol=1e-9 * peak)
    with np.errstate(invalid="ignore"):  # of the branch that it does not take
        back = colour.models.eotf_inverse_BT2100_HLG(shown, 0, peak, method="ITU-R BT.2100-2")
    np.testing.assert_allclose(HLG(peak).encode(shown / peak), back, atol=1e-6)


def test_hlg_of_dim_displays_has_the_gamma_of_the_extended_range():
    """ITU-R BT.2100-3, note 5f; both formulas agree at 1000 cd/m2."""
    assert HLG(1000.0).gamma == pytest.approx(1.2)
    assert HLG(125.0).gamma == pytest.approx(1.2 / 1.111**3)
    assert HLG(4000.0).gamma == pytest.approx(1.2 * 1.111**2)
    # BT.2408-7, table 1: reference white has code 0.75, and 203 cd/m2
    assert HLG(1000.0).decode(np.full(3, 0.75)) * 1000 == pytest.approx(203, abs=0.5)


def test_what_no_display_shows_of_hlg_is_odd_and_counts_for_nothing():
    codes = HLG(1000.0).encode(np.array([[0.5, -0.1, 0.0], [0.0, 0.0, 0.0]]))
    assert codes[0, 1] < 0
    np.testing.assert_allclose(HLG(1000.0).decode(codes)[0, 0], 0.5, rtol=1e-9)
    assert np.array_equal(codes[1], np.zeros(3))


def test_known_points():
    assert DCDM().encode(np.array(1.0)) == pytest.approx((48 / 52.37) ** (1 / 2.6))
    assert ST2084(100.0).encode(np.array(1.0)) == pytest.approx(0.508078, abs=1e-6)  # BT.2408
    assert SRGB().decode(np.array(0.5)) == pytest.approx(0.214041, abs=1e-6)


def test_values_outside_the_range_are_not_clamped():
    values = np.array([-0.2, 1.5])
    assert Gamma(2.0).decode(values) == pytest.approx([-0.04, 2.25])
    assert Gamma(2.0).encode(Gamma(2.0).decode(values)) == pytest.approx(values)


def test_absolute_curves_end_at_their_peak():
    assert ST2084(100.0).decode(np.array([1.0, 3.0])) == pytest.approx([100.0, 100.0])


@pytest.mark.parametrize(
    ("light", "message"),
    [
        ([0, 0.5, 0.4, 1], "must increase strictly"),
        ([0, 0.5, np.nan, 1], "must increase strictly"),
        ([0.1, 0.5, 0.6, 1], "must run from 0 to 1"),
        ([0, 0.5, 0.6, 0.9], "must run from 0 to 1"),
    ],
)
def test_an_impossible_measurement_is_refused(light, message):
    with pytest.raises(InputError, match=message):
        MeasuredTable(np.linspace(0, 1, 4), np.array(light)[:, None])


@pytest.mark.parametrize(
    "name", ["linear", "srgb", "bt1886", "gamma2.35", "st2084", "dcdm", "hlg400"]
)
def test_curves_are_found_by_name(name):
    curve = named(name, white=48)
    assert not curve.decode(np.zeros(3)).any()
    assert not curve.encode(np.zeros(3)).any()


@pytest.mark.parametrize("name", ["log", "gamma", "gamma0", "gammax", "", "hlg2", "hlgnan"])
def test_an_unknown_name_is_refused(name):
    with pytest.raises(InputError, match="use one of"):
        named(name, white=48)


@pytest.mark.parametrize("bits", [8, 12, 16])
@pytest.mark.parametrize("curve", [SRGB(), ST2084(108.0), DCDM()])
def test_many_codes_are_decoded_as_few_are(curve: Transfer, bits: int) -> None:
    codes = np.arange(1 << bits, dtype=np.float32) / np.float32((1 << bits) - 1)
    many = np.random.default_rng(35).choice(codes, 1 << 17)
    few = np.concatenate([curve.decode(part) for part in np.split(many, 64)])
    np.testing.assert_array_equal(curve.decode(many), few)
