"""Visible differences: thresholds of gratings, the formula by hand, and what must not matter."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from compensate.vision.castle import COLORVIDEOVDP, DETAIL, DKL_FROM_XYZ, castle
from compensate.vision.differences import (
    EXPONENT,
    JOD,
    PEAK,
    STILL,
    Reference,
    bands,
    expanded,
    in_thresholds,
    mutually_masked,
    quality_lost,
    reduced,
    visible_difference,
)
from domesim.errors import InputError
from domesim.light import strips

PER_DEGREE, SIZE = 20.0, 256
WHITE = np.array([0.95, 1.0, 1.09])  # XYZ of D65
GREY = WHITE / (DKL_FROM_XYZ @ WHITE)[0]  # to which the achromatic mechanism responds by 1


def grating(frequency: float, size: int = SIZE, per_degree: float = PER_DEGREE) -> np.ndarray:
    """(row, col) cosine along the columns, cycles/degree; one crest is on a pixel's centre."""
    across = np.arange(size) / per_degree
    return np.broadcast_to(np.cos(2 * np.pi * frequency * across), (size, size))


def field(luminance: object) -> np.ndarray:
    """XYZ of grey of that luminance, (row, col) or one number."""
    planes = np.broadcast_to(luminance, (SIZE, SIZE)) if np.ndim(luminance) == 0 else luminance
    return (np.asarray(planes)[None, ..., None] * GREY).astype(np.float32)


def spot(size: int = SIZE, width: float = 0.5, per_degree: float = PER_DEGREE) -> np.ndarray:
    place = (np.arange(size) + 0.5 - size / 2) / per_degree
    return np.exp(-(place[:, None] ** 2 + place**2) / (2 * width**2))


def amplitude(
    plane: np.ndarray, number: int, frequency: float, per_degree: float = PER_DEGREE
) -> float:
    """How much of a grating is in the (row, col) plane of a band, far from the edges."""
    wave = grating(frequency, plane.shape[-1], per_degree / 2**number)[0]
    inner = slice(plane.shape[-1] // 4, -plane.shape[-1] // 4)
    return float(np.mean(plane[:, inner] * wave[inner]) / np.mean(wave[inner] ** 2))


def middle(planes: np.ndarray) -> np.ndarray:
    return planes[..., SIZE // 4 : -SIZE // 4, SIZE // 4 : -SIZE // 4]


def low_pass(frequency: float) -> float:
    """Transfer function of the pyramid's taps; 1 is the Nyquist frequency."""
    angle = np.pi * frequency
    return float(0.4 + 0.5 * np.cos(angle) + 0.1 * np.cos(2 * angle))


def gain(number: int, frequency: float) -> float:
    """Gain of a band of the pyramid for a grating along an axis, in shares of its own Nyquist."""
    passed = [low_pass(frequency / 2.0**k) for k in range(1, number + 1)]
    return float(np.prod([*passed, 1 - low_pass(frequency) ** 2]))


def sensitivity(mechanism: int, frequency: float, luminance: float) -> float:
    """As ColorVideoVDP has it: -0.28 dB off its table, and 1.45 times that for red-green."""
    found = castle(frequency, luminance, COLORVIDEOVDP[mechanism], area=DETAIL)
    return float(found) * 10 ** (-0.2797423303127289 / 20) * (1, 1.45, 1)[mechanism]


# Thresholds.


@pytest.mark.parametrize("luminance", [0.1, 5.0, 60.0])
@pytest.mark.parametrize("mechanism", range(3))
@pytest.mark.parametrize("number", range(4))
def test_a_grating_at_its_threshold_is_at_one(
    number: int, mechanism: int, luminance: float
) -> None:
    """In its band, for the mechanism that it is made for; in the others it makes nothing.

    The band's gain is taken as 1/2, and it is near that.
    """
    frequency = bands(field(luminance), field(luminance), PER_DEGREE)[number].frequency
    threshold = 1 / sensitivity(mechanism, frequency, luminance)
    responses = np.zeros(3)
    responses[mechanism] = luminance * threshold
    change = np.linalg.solve(DKL_FROM_XYZ, responses)
    seen = (field(luminance) + grating(frequency)[None, ..., None] * change).astype(np.float32)
    band = bands(field(luminance), seen, PER_DEGREE)[number]
    found = [amplitude(planes, number, frequency) for planes in (band.seen - band.wanted)[0]]
    ratio = 2 * gain(number, PEAK) if number else 1
    assert ratio == pytest.approx(1, abs=0.25)
    assert found[mechanism] == pytest.approx(ratio, rel=0.01)
    assert np.abs(np.delete(found, mechanism)).max() < 0.01


def test_the_bands_gains_are_those_of_the_pyramid() -> None:
    for number, place in ((0, 1.0), (1, PEAK), (2, PEAK), (3, 0.3)):
        planes = grating(place / 2 / 2**number, 512, 1.0)[None].astype(np.float32)
        for _ in range(number):
            planes = reduced(planes)
        band = planes - expanded(reduced(planes), planes.shape[-2:])
        found = amplitude(band[0], number, place / 2 / 2**number, 1.0)
        assert found == pytest.approx(gain(number, place), rel=0.005)


@pytest.mark.parametrize("size", [(1, 1), (1, 6), (5, 2), (12, 31)])
def test_even_light_stays_even(size: tuple[int, int]) -> None:
    plane = np.full((2, *size), 3.0, np.float32)
    fewer = reduced(plane)
    assert fewer.shape == (2, -(-size[0] // 2), -(-size[1] // 2))
    for each in (fewer, expanded(fewer, size)):
        np.testing.assert_allclose(each, 3.0, rtol=1e-6)
    assert expanded(fewer, size).shape == plane.shape


def test_frequencies_are_published_ones_an_octave_apart() -> None:
    found = [band.frequency for band in bands(field(5.0), field(5.0), PER_DEGREE)]
    assert found[:3] == pytest.approx([10, 3.228, 1.614])
    assert found[-2] > 0.2 >= found[-1]


# The formula.


Q = (1.302622675895691, 2.8885908126831055, 3.6807713508605957)
ACROSS = [[-0.1895, -5.9622, -4.3183], [2.5656, 0.3441, -2.7196], [3.8118, -1.0052, -0.5193]]


def by_hand(wanted: list[float], seen: list[float]) -> list[float]:
    """D_k of the mechanisms where the same is all around."""
    found = []
    both = [
        10**-0.7954971194267273 * min(abs(t), abs(u)) for t, u in zip(wanted, seen, strict=True)
    ]
    for k in range(3):
        mask = sum(2 ** ACROSS[j][k] * both[j] ** Q[j] for j in range(3))
        unclamped = abs(wanted[k] - seen[k]) ** 2.264355182647705 / (1 + mask)
        most = 10**2.5642454624176025
        found.append(most * unclamped / (most + unclamped))
    return found


@pytest.mark.parametrize(
    ("wanted", "seen"),
    [
        ([0.0, 0.0, 0.0], [1.0, -3.0, 8.0]),
        ([2.0, 5.0, -7.0], [2.5, 3.0, -9.0]),
        ([-20.0, 30.0, 1.0], [20.0, 80.0, 0.0]),
    ],
)
@pytest.mark.parametrize("size", [4, 9])
def test_the_masking_by_hand(wanted: list[float], seen: list[float], size: int) -> None:
    planes = [
        np.ones((3, size, size), np.float32) * np.reshape(t, (3, 1, 1)) for t in (wanted, seen)
    ]
    found = mutually_masked(*(plane.astype(np.float32) for plane in planes))[:, 1, 2]
    assert found == pytest.approx(by_hand(wanted, seen), rel=1e-4)


def test_masks_are_smoothed_but_in_small_bands() -> None:
    both = np.zeros((3, 13, 13), np.float32)
    both[0, 6, 6] = 60.0
    seen = both.copy()
    seen[0, 6, 8] = 5.0
    alone = mutually_masked(both, seen)[0]
    small = mutually_masked(both[:, 4:10, 4:10], seen[:, 4:10, 4:10])[0]
    assert small[2, 4] == pytest.approx(by_hand([0, 0, 0], [5.0, 0, 0])[0], rel=1e-4)
    assert alone[6, 8] < 0.98 * small[2, 4]


def test_the_whole_by_hand() -> None:
    """A grating at ten times its threshold: its band's and its neighbours' differences add up."""
    frequency = 1.614
    contrast = 10 / sensitivity(0, frequency, 5.0)
    seen = field(5.0 * (1 + contrast * grating(frequency)))
    found = visible_difference(field(5.0), seen, PER_DEGREE)
    total, fourths = 0.0, 0.0
    for number in range(4):
        g = 0.5 if number else 1.0
        place = PEAK if number else 1.0
        own = place * PER_DEGREE / 2 / 2**number
        here = frequency / (PER_DEGREE / 2 / 2**number)
        passed = gain(number, here) / g if here < 1 else 0.0
        signal = contrast * sensitivity(0, own, 5.0) * passed
        total += g * by_hand([0, 0, 0], [signal, 0, 0])[0]
        wave = signal * np.cos(np.linspace(0, 2 * np.pi, 1000, endpoint=False))
        unclamped = np.abs(wave) ** 2.264355182647705
        most = 10**2.5642454624176025
        fourths += np.mean((most * unclamped / (most + unclamped)) ** 2) ** 2
    # |cos|^p, smoothed by the pyramid's way up, is between its mean and its crest
    crest = JOD * (STILL * total) ** EXPONENT
    assert 0.5 * crest < middle(found).mean() < crest
    assert middle(found).max() == pytest.approx(crest, rel=0.25)
    # The one figure: root-mean-squares in each band
    pooled = Reference(field(5.0), PER_DEGREE).pooled(seen)
    assert pooled[0] == pytest.approx(STILL * fourths**0.25, rel=0.05)


def test_thresholds_are_those_of_what_is_lost() -> None:
    thresholds = np.array([0.0, 0.05, 0.17, 0.2, 5.0, 300.0])
    lost = quality_lost(STILL * thresholds)
    np.testing.assert_allclose(in_thresholds(lost), thresholds, rtol=1e-5)
    assert (np.diff(lost) > 0).all()


# Laws.


def test_where_nothing_differs_nothing_is_seen() -> None:
    picture = field(0.01 + 20 * spot())
    assert not visible_difference(picture, picture, PER_DEGREE).any()
    other = field(0.01 + 20 * spot() + 0.5 * np.roll(spot(width=0.05), 90, axis=1))
    found = visible_difference(picture, other, PER_DEGREE)[0]
    assert found[SIZE // 2, SIZE // 2 + 90] > 0.5
    assert found[:, :30].max() < 1e-3


@pytest.mark.parametrize("sign", [-1, 1])
def test_more_difference_is_more_visible(sign: int) -> None:
    ghost = sign * spot(width=0.1)
    found = [
        visible_difference(field(5.0), field(5.0 * (1 + size * ghost)), PER_DEGREE)
        for size in (0.003, 0.02, 0.1, 0.3, 0.9)
    ]
    crests = [each.max() for each in found]
    assert crests == sorted(crests)
    assert crests[0] < 0.02
    assert crests[-1] > 2
    near = (0, slice(120, 136), slice(120, 136))
    for less, more in pairwise(found):
        assert (more[near] > less[near]).all()


def test_a_texture_of_its_kind_masks_a_difference() -> None:
    texture = 0.5 * grating(3.228)
    ghost = 0.1 * grating(3.228)
    plain = visible_difference(field(10.0), field(10 * (1 + ghost)), PER_DEGREE)
    masked = visible_difference(
        field(10 * (1 + texture)), field(10 * (1 + texture + ghost)), PER_DEGREE
    )
    coarse = 10 * (1 + 0.5 * grating(0.2))
    aside = visible_difference(field(coarse), field(coarse * (1 + ghost)), PER_DEGREE)
    assert middle(masked).mean() < 0.4 * middle(plain).mean()
    assert middle(aside).mean() > 2 * middle(masked).mean()


def test_the_eye_is_adapted_to_what_is_wanted() -> None:
    picture = field(1 + 5 * spot(width=0.3))
    alone = bands(picture, picture, PER_DEGREE)
    beside = bands(picture, picture + 8 * field(spot()), PER_DEGREE)
    for one, other in zip(alone, beside, strict=True):
        np.testing.assert_array_equal(one.wanted, other.wanted)
        assert np.abs(one.wanted).max() > 1


def test_black_is_no_darker_than_the_eye_sees() -> None:
    ghost = 0.05 * spot(width=0.1)
    on = [
        visible_difference(field(level), field(level + ghost), PER_DEGREE).max()
        for level in (0, 0.002)
    ]
    assert on[0] > 0.1
    assert on[1] == pytest.approx(on[0], rel=0.05)


def test_a_change_of_hue_that_is_alike_everywhere_is_pooled_as_it_is_mapped() -> None:
    """Only the base band has it."""
    wanted = field(5.0)
    reddish = wanted * np.array([1.05, 1, 0.9], np.float32)
    mapped = visible_difference(wanted, reddish, PER_DEGREE)
    assert mapped.min() > 0.1
    pooled = quality_lost(Reference(wanted, PER_DEGREE).pooled(reddish))
    np.testing.assert_allclose(pooled, mapped.mean(), rtol=0.05)


@pytest.mark.parametrize("finer", [2, 3])
def test_finer_pixels_see_the_same(finer: int) -> None:
    """Of pictures that coarse ones can hold."""

    def found(times: int) -> np.ndarray:
        density, size = times * PER_DEGREE, times * 128
        planes = (10 * spot(size, 0.8, density), 0.6 * spot(size, 0.4, density))
        wanted, seen = (
            (plane[None, ..., None] * GREY).astype(np.float32)
            for plane in (0.1 + planes[0], 0.1 + planes[0] + np.roll(planes[1], size // 5, 1))
        )
        each = visible_difference(wanted, seen, density)
        return each.reshape(128, times, 128, times).mean((1, 3))

    one, other = found(1), found(finer)
    assert one.max() > 0.3
    # Bands of thirds of the resolution lie between those of the whole
    assert np.abs(one - other).max() < (0.15 if finer == 2 else 0.3) * one.max()


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (7, 2), (33, 50), (64, 31)])
def test_all_sizes(size: tuple[int, int]) -> None:
    random = np.random.default_rng(0)
    wanted, seen = random.random((2, 2, *size, 3)).astype(np.float32)
    found = visible_difference(wanted, seen, PER_DEGREE)
    assert found.shape == (2, *size)
    assert np.isfinite(found).all()
    assert found.dtype == np.float32
    turned = [np.swapaxes(each, 1, 2) for each in (wanted, seen)]
    across = np.swapaxes(visible_difference(turned[0], turned[1], PER_DEGREE), 1, 2)
    np.testing.assert_allclose(across, found, rtol=1e-3, atol=1e-5)


def test_what_counts_in_part_is_pooled_in_part() -> None:
    """Shares that add up to all have squares that add up to all's."""
    random = np.random.default_rng(3)
    reference = Reference(field(5.0), PER_DEGREE)
    seen = field(5.0) * (1 + 0.3 * random.random((1, SIZE, SIZE, 1))).astype(np.float32)
    left = np.zeros((SIZE, SIZE), np.float32)
    left[:, : SIZE // 4] = 1
    whole, *parts = (reference.pooled(seen, share)[0] for share in (None, left, 1 - left))
    assert whole == pytest.approx(reference.pooled(seen, np.ones_like(left))[0], rel=1e-6)
    assert whole == pytest.approx(np.hypot(*parts), rel=0.02)
    assert parts[0] == pytest.approx(whole / 2, rel=0.05)


def test_strips_and_what_comparisons_share_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(35)
    wanted = (30 * rng.random((2, 33, 70, 3)) ** 4).astype(np.float32)
    seen = [wanted * (1 + size * rng.random(wanted.shape)) for size in (0.1, 0.3)]
    alone = [visible_difference(wanted, each, PER_DEGREE) for each in seen]
    pooled = [Reference(wanted, PER_DEGREE).pooled(each) for each in seen]
    monkeypatch.setattr(strips, "SAMPLES", 1000)  # a few rows
    reference = Reference(wanted, PER_DEGREE)
    for each, expected in zip(seen, alone, strict=True):
        np.testing.assert_array_equal(reference.difference(each), expected)
        assert reference.pooled(each) == pytest.approx(pooled.pop(0), rel=1e-6)


def test_a_density_that_cannot_be() -> None:
    with pytest.raises(InputError, match="per degree"):
        visible_difference(field(1.0), field(1.0), 0.0)
