"""A room's transport from photographs alone, against radiosity, which computes it from geometry."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up_domes import GAIN, THEATRE, patterns, seen, truth
from told_numbers import assert_same_but_for_last_digits

from domesim.errors import InputError
from domesim.measure.dome.photographs import Photographs
from domesim.measure.dome.ranks import Ranks, cross_validated, independent_of
from domesim.measure.dome.reflected import DECAY, MIXING, both_ways, fitted
from domesim.measure.dome.responses import Responses, excitations, responses_of
from domesim.measure.dome.without_geometry import Found, found_in, lines_of
from domesim.observation.basis import ScreenBasis
from domesim.observation.transport import Transport, node_places
from domesim.room.furniture import box
from domesim.room.theatre import Lens, Lobe
from testing.masters import night
from testing.statistics import calibration

DEGREE = 4


def responses(shots: Photographs, lit: np.ndarray | None = None, degree=DEGREE) -> Responses:
    return responses_of(THEATRE, patterns() if lit is None else lit, shots, degree)


def found(shots: Photographs, lit: np.ndarray | None = None) -> Found:
    return found_in(responses(shots, lit), THEATRE)


def some(shots: Photographs, kept: list[int]) -> tuple[Photographs, np.ndarray]:
    """Photographs of some patterns, and those patterns."""
    few = Photographs(shots.camera, shots.light[kept], np.arange(len(kept)), np.ones(len(kept)))
    return few, patterns()[kept]


@pytest.fixture(scope="module")
def whole() -> Found:
    return found(seen(truth(), patterns()))


def reflected(transport: Transport, light: np.ndarray) -> np.ndarray:
    dark = replace(transport, ambient=np.zeros_like(transport.ambient))
    size = light.shape[1]
    inside = transport.dome.inside(size, size)[None, ..., None]
    return np.asarray((dark.observation(size, size).observe(light) - light) * inside, np.float64)


def test_it_is_what_radiosity_computes(whole):
    white = truth().mean_gain()
    assert np.all(np.abs(whole.white - white) < 4 * whole.white_error)
    assert np.all(np.abs(whole.white / white - 1) < 0.005)
    picture = night(64)
    picture[:, :32] = 0  # the back
    wanted = reflected(truth(), picture)
    off = reflected(whole.transport, picture) - wanted
    assert np.sqrt(np.mean(off**2)) < 0.01 * np.sqrt(np.mean(wanted**2))
    # The floor makes it uneven: what one mode cannot tell.
    even = wanted.sum((1, 2)) / THEATRE.dome.inside(64, 64).sum()
    flat = even[:, None, None] * THEATRE.dome.inside(64, 64)[None, ..., None] - wanted
    assert np.sqrt(np.mean(flat**2)) > 0.03 * np.sqrt(np.mean(wanted**2))


def test_gain_and_black_are_found(whole):
    assert whole.gain == pytest.approx(np.array(GAIN), rel=0.03)  # vignetting is in it
    assert whole.ambient == pytest.approx(np.full(3, 0.003), rel=0.03)
    assert 0.95 < whole.chi2 / whole.degrees < 1.05
    assert whole.hidden == 0
    assert (whole.photographs, whole.patterns) == (17, 16)


@pytest.mark.long
def test_heavy_tails_do_not_make_it_dark():
    """Weighed by what was seen, what is dark by chance counts for more: gains were 4 % too low."""
    shots = seen(truth(), patterns(), noise=0, vignetting=0)
    drawn = np.exp(np.random.default_rng(0).standard_normal(shots.light.shape))
    noise = 0.2 * (drawn - np.exp(0.5)) / np.sqrt((np.e - 1) * np.e)
    dim = found_in(responses(replace(shots, light=shots.light * (1 + noise)), degree=2), THEATRE)
    assert np.all(np.abs(dim.gain / GAIN - 1) < 0.025)
    assert np.all(np.abs(dim.white / truth().mean_gain() - 1) < 0.02)
    assert dim.misfit < 1.5


def test_exposures_are_divided_out():
    shots = seen(truth(), patterns(), size=48)
    times = np.linspace(0.5, 8, len(shots.light))
    given = replace(shots, light=shots.light * times[:, None, None, None], exposure=times)
    one, other = (responses(each, degree=1) for each in (shots, given))
    assert np.allclose(one.value, other.value)
    assert np.allclose(one.variance, other.variance)


def test_larger_photographs_are_binned():
    large, small = (
        responses(seen(truth(), patterns(), size=size, noise=0.02), degree=2) for size in (216, 72)
    )
    assert large.value.shape[1] < 1.3 * small.value.shape[1]
    ratio = np.median(small.variance[1, :, 1]) / np.median(large.variance[1, :, 1])
    assert ratio == pytest.approx(9, rel=0.1)
    assert np.median(large.variance[1, :, 1]) ** 0.5 == pytest.approx(
        0.02 / 3 * np.median(large.value[1, :, 1]), rel=0.1
    )


def test_what_hides_the_screen_is_left_out(whole):
    shots = seen(truth(), patterns(), size=64)
    light = shots.light.copy()
    # A head, lit by the screen: it shows a little of everything
    light[:, 22:32, 20:34] = 0.05 * shots.light.mean((1, 2), keepdims=True)
    covered = found(replace(shots, light=light))
    assert 60 < covered.hidden <= 140
    assert np.all(np.abs(covered.white / truth().mean_gain() - 1) < 0.005)
    assert covered.misfit < 1.1


def test_a_pattern_mixed_up_is_refused():
    shots = seen(truth(), patterns())
    light = shots.light.copy()
    light[[2, 3]] = light[[3, 2]]
    with pytest.raises(InputError, match="not what the patterns can look like"):
        found(replace(shots, light=light))


@pytest.mark.parametrize(
    ("kept", "message"),
    [
        ([0, 1], "no place on the screen was photographed lit and unlit and under a third"),
        ([0, 2, 4], "too few patterns: with one left out"),
    ],
    ids=["black and white", "black and both halves"],
)
def test_what_cannot_be_told_is_refused(kept, message):
    with pytest.raises(InputError, match=message):
        found(*some(seen(truth(), patterns()), kept))


def test_patterns_that_are_too_few_are_told():
    assert found(*some(seen(truth(), patterns()), [0, 1, 2, 3])).ranks.exhausted
    four = Ranks(np.array([0.02, 0.01, 0.006, 0.004]), 4, 5, 1.0)
    assert four.exhausted
    assert not replace(four, rank=3).exhausted
    assert not replace(four, error=np.array([0.02, 0.001, 0.0009, 0.0003])).exhausted


@pytest.mark.parametrize(
    ("error", "told"),
    [(0.04, "smooth modes leave 4.0% of the reflected light unexplained"), (0.004, None)],
)
def test_a_room_that_smooth_modes_do_not_explain_is_told(whole, error, told):
    ranks = Ranks(np.array([0.05, 0.045, 0.041, 0.0405, error]), 5, 9, 1.0)
    task = SimpleNamespace(registered=None, file=SimpleNamespace(absolute=False))
    lines = [
        line for line in lines_of(task, replace(whole, ranks=ranks)) if "check the room" in line
    ]
    assert [told is not None and told in line for line in lines] == [True] * (told is not None)


def of_rank(rank: int) -> Transport:
    """An integrating sphere, with strong even modes besides."""
    basis = ScreenBasis(THEATRE.dome, DEGREE)
    tables = basis.at(*np.meshgrid(*2 * [node_places(49)]))
    core = np.zeros((3, len(basis), len(basis)))
    sizes = np.array([0.4, 0.05, -0.04, 0.03, 0.025])[:rank]
    core[:, np.arange(rank), np.arange(rank)] = sizes
    return Transport(THEATRE.dome, tables, core, 0 * core, np.zeros((3, 49, 49)))


@pytest.mark.parametrize(
    "rank", [pytest.param(1, marks=pytest.mark.long), 3, pytest.param(5, marks=pytest.mark.long)]
)
def test_cross_validation_finds_the_rank(rank):
    told = responses(seen(of_rank(rank), patterns(), noise=0.003))
    ranks = cross_validated(told, [fitted(told, p) for p in range(3)])
    assert ranks is not None
    assert ranks.rank == rank
    assert np.all(ranks.error[: rank - 1] > 0.01)
    assert ranks.error[rank - 1] < 0.005
    assert not ranks.exhausted


def test_what_is_left_out_is_no_sum_of_what_is_kept():
    """White is both halves; leaving out white alone would test nothing."""
    white, right, left, *rings = range(1, 7)
    told = responses(*some(seen(truth(), patterns(), size=32), [0, 1, 2, 4, 12, 13, 14]), degree=1)
    kept = independent_of(told, white)
    assert not kept[white]
    assert kept[[right, left]].sum() == 1
    assert kept[rings].sum() == 2
    kept = independent_of(told, right)
    assert not kept[right]
    assert kept[[white, left]].sum() == 1
    # Black tells nothing of any other
    assert kept[0]


def page_of(told: Responses) -> tuple[Found, str]:
    """What is found, and what is printed of it."""
    result = found_in(told, THEATRE)
    task = SimpleNamespace(registered=None, file=SimpleNamespace(absolute=False))
    return result, "\n".join(lines_of(task, result))


@cache
def tying() -> tuple[Responses, Found, str]:
    """Photographs of halves and of three equal rings, which add up to white; the front half twice.

    Each of them has the same share in white as another.
    """
    lit = patterns()[[0, 1, 2, 3, 2, 4, 5, 12, 13, 14]]
    told = responses(seen(truth(), lit, size=32), lit, degree=1)
    return told, *page_of(told)


@settings(max_examples=8, deadline=None)
@given(st.permutations(range(10)), st.integers(0, 2**31))
def test_rounding_decides_nothing_between_equal_patterns(order, seed):
    """Permuted and changed by 1e-13: the same modes, the same page."""
    told, wanted, page = tying()
    rng = np.random.default_rng(seed)

    def changed(values):
        return values[order] * (1 + 1e-13 * rng.uniform(-1, 1, values.shape))

    other = replace(
        told,
        value=changed(told.value),
        direct=changed(told.direct),
        excitation=changed(told.excitation),
        variance=told.variance[order],
        pattern=told.pattern[order],
        noise=[told.noise[shot] for shot in order],
    )
    for pattern in told.pattern:
        kept = independent_of(other, pattern)
        np.testing.assert_array_equal(kept, independent_of(told, pattern)[order])
    result, again = page_of(other)
    assert result.ranks.rank == wanted.ranks.rank
    modes, same = (each.transport.modes.reshape(each.ranks.rank, -1) for each in (result, wanted))
    assert np.abs(modes @ same.T) == pytest.approx(np.abs(same @ same.T), rel=1e-6, abs=1e-6)
    assert_same_but_for_last_digits(again, page)


def drawn(seed: int) -> tuple[Responses, np.ndarray]:
    """Responses of a core that is as large as the fit expects, and the core."""
    rng = np.random.default_rng(seed)
    size = 0.02
    basis = ScreenBasis(THEATRE.dome, DEGREE)
    degrees, count = basis.degrees, len(basis)
    spread = 0.3 * size * DECAY ** ((degrees[:, None] + degrees) / 2)
    spread *= np.where(np.eye(count, dtype=bool), 1, MIXING)
    core = spread * rng.standard_normal((3, count, count))
    core = np.triu(core) + np.triu(core, 1).transpose(0, 2, 1)
    core[:, 0, 0] = 0.3
    tables = basis.at(*np.meshgrid(*2 * [node_places(49)]))
    room = Transport(THEATRE.dome, tables, core, 0 * core, np.zeros((3, 49, 49)))
    return responses(seen(room, patterns(), seed=seed, size=48)), core


def test_standard_errors_are_right():
    z = []
    for seed in range(4):
        told, core = drawn(seed)
        parts = np.eye(core[0].size).reshape(-1, *core[0].shape)
        for p in range(3):
            core_found = fitted(told, p)
            error = np.sqrt(np.diag(core_found.uncertainty.of(parts))).reshape(core[p].shape)
            z.append((core_found.core - core[p]) / error)
    z = np.array(z)
    # Cautious, as rooms have some parts that are larger than the others
    assert 0.6 < np.sqrt(np.mean(z**2)) < 1
    assert np.mean(np.abs(z) < 1.96) > 0.93
    assert 0.5 < np.sqrt(np.mean(z[:, 0, 0] ** 2)) < 1.8
    assert calibration(z[:, 0, 0]) > 1e-3


def test_a_core_is_taken_apart_and_put_together():
    turn = both_ways(4).toarray()
    assert np.allclose(turn @ turn.T, np.eye(16))
    core = np.random.default_rng(0).random((4, 4))
    assert np.allclose((turn @ (core + core.T).ravel())[10:], 0)
    assert np.allclose((turn @ (core - core.T).ravel())[:10], 0)


def test_light_through_lenses_excites_by_what_they_give():
    """A lens off the centre without correction lights the screen unevenly."""
    lens = Lens("one", (0.0, -2.0, 0.0), (0.0, 0.0, 4.0), field=2 * np.pi)
    uneven = replace(THEATRE, lenses=(lens,), corrected=False)
    basis = ScreenBasis(THEATRE.dome, 2)
    white = patterns()[1:2]
    even = excitations(THEATRE, white, basis)[0, 0]
    assert even == pytest.approx([1, 0, 0, 0, 0, 0], abs=2e-3)
    moved = excitations(uneven, white, basis)[0, 0]
    # v grows to the front, and the lens stands at the back
    assert moved[0] != pytest.approx(1, abs=0.01)
    assert np.abs(moved[1:3]).max() > 0.1


def test_what_is_described_besides_the_screen_does_not_matter():
    """What a camera sees of a gain screen's direct light is its unit, whatever the file says."""
    shots = seen(truth(), patterns(), size=48)
    furnished = replace(
        THEATRE,
        lobe=Lobe(0.3, 0.3),
        solids=(box("booth", (-1.0, 1.0, -1.0), (1.0, 2.0, 2.0), (0.1, 0.1, 0.1)),),
    )
    one, other = (responses_of(each, patterns(), shots, 2) for each in (THEATRE, furnished))
    assert np.array_equal(one.direct, other.direct)
    assert np.array_equal(one.value, other.value)
