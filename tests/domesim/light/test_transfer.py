"""Transfer functions: exact inverses at every code, and colour-science as an independent oracle."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from domesim.errors import InputError
from domesim.light.transfer import DCDM, SRGB, ST2084, Gamma, Linear, MeasuredTable, Transfer, named

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


@pytest.mark.parametrize("name", ["linear", "srgb", "bt1886", "gamma2.35", "st2084", "dcdm"])
def test_curves_are_found_by_name(name):
    assert named(name, white=48).decode(np.array([0.0])) == 0


@pytest.mark.parametrize("name", ["log", "gamma", "gamma0", "gammax", "gamma9", ""])
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
