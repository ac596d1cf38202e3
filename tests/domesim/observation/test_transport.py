"""Stored transports: files that cannot lie, and observations against sums written out."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.observation.basis import ScreenBasis, disc_quadrature
from domesim.observation.spherical import ClosedFormDome, closed_form_gain
from domesim.observation.transport import (
    FORMAT,
    MARGIN,
    Transport,
    interpolation,
    load_transport,
    node_places,
    sample_nodes,
)
from domesim.room.dome import Dome

Floats = NDArray[np.float64]

CAP = Dome(3.0, np.radians(105), 0.2)
DOMES = {
    "cap": CAP,
    "ellipsoid": Dome(2.5, np.radians(80), 0.1, 0.7),
    "truncated": Dome(4.0, np.radians(120), 0.3, truncated_below=-0.5),
}
every_dome = pytest.mark.parametrize("dome", DOMES.values(), ids=DOMES)
ARRAYS = ("modes", "core", "core_error", "ambient")


def smooth(dome: Dome = CAP, degree: int = 2, nodes: int = 21, seed: int = 0) -> Transport:
    """Polynomials that excite each other at random, differently for each primary."""
    random = np.random.default_rng(seed)
    modes = ScreenBasis(dome, degree).at(*np.meshgrid(node_places(nodes), node_places(nodes)))
    core = 0.2 * random.standard_normal((3, len(modes), len(modes)))
    core[:, 0, 0] = 0.5, 0.3, 0.4
    error = 0.01 * random.random(core.shape)
    ambient = 0.01 * random.random((3, nodes, nodes))
    made = {"scene": "Zeiss-Großplanetarium", "figures": [1, 2.5, None], "method": {"seed": 3}}
    return Transport(dome, modes, core, error, ambient, made)


def bare(dome: Dome, albedo: Any, nodes: int = 9) -> Transport:
    gains = [closed_form_gain(rho, dome.radius, dome.screen_area) for rho in albedo]
    core = np.array(gains)[:, None, None] * dome.screen_area
    dark = np.zeros((3, nodes, nodes))
    return Transport(dome, np.ones((1, nodes, nodes)), core, 0 * core, dark)


def light(size: int, seed: int = 0) -> Floats:
    return np.random.default_rng(seed).random((1, size, size, 3))


def same(one: Transport, other: Transport) -> bool:
    return (
        all(np.array_equal(getattr(one, name), getattr(other, name)) for name in ARRAYS)
        and one.dome == other.dome
        and one.provenance == other.provenance
    )


def dense(transport: Transport, primary: int) -> Floats:
    """The operator between points of the screen, scaled so that its norms are those of areas."""
    u, v, areas = disc_quadrature(transport.dome, 12)
    modes = sample_nodes(transport.modes, u, v)
    root = np.sqrt(areas / areas.sum())
    return np.asarray((modes * root).T @ transport.core[primary] @ (modes * root))


# Files


@every_dome
def test_a_file_brings_back_every_bit(dome: Dome, tmp_path: Path) -> None:
    stored = smooth(dome)
    stored.save(tmp_path / "a.npz")
    found = load_transport(tmp_path / "a.npz")
    assert same(found, stored)
    for name in ARRAYS:
        assert getattr(found, name).tobytes() == getattr(stored, name).tobytes()
    assert [item.name for item in tmp_path.iterdir()] == ["a.npz"]


def places(raw: bytes) -> list[int]:
    """All of the first member's header and the last's directory entry, and every 17th byte."""
    return sorted({*range(64), *range(17, len(raw), 17), *range(len(raw) - 90, len(raw))})


def test_a_flipped_bit_is_noticed_or_changes_nothing(tmp_path: Path) -> None:
    """There are bits that nothing depends on, such as a file's date in a zip."""
    stored, path = smooth(degree=1, nodes=7), tmp_path / "a.npz"
    stored.save(path)
    raw = path.read_bytes()
    refused = 0
    for at in places(raw):
        for bit in (at % 8, 0):
            path.write_bytes(raw[:at] + bytes([raw[at] ^ (1 << bit)]) + raw[at + 1 :])
            try:
                assert same(load_transport(path), stored), f"bit {bit} of byte {at}"
            except InputError:
                refused += 1
    assert refused > 1.2 * len(places(raw))


def arrays_of(transport: Transport, **changes: Any) -> dict[str, Any]:
    """What a file holds, changed, with a checksum that fits."""
    dome = transport.dome
    found = {
        "format": np.array(FORMAT),
        "dome": np.array([dome.radius, dome.half_angle, dome.tilt, dome.height_ratio, np.nan]),
        **{name: getattr(transport, name) for name in ARRAYS},
        "provenance": np.array('{"scene": "x"}'),
    } | changes
    digest = hashlib.sha256()
    for name in ("format", "dome", *ARRAYS, "provenance"):
        digest.update(np.ascontiguousarray(found[name]).tobytes())
    return {name: value for name, value in found.items() if value is not None} | {
        "sha256": np.array(digest.hexdigest())
    }


def test_the_format_is_what_the_module_says(tmp_path: Path) -> None:
    """Written by hand after the module's docstring."""
    np.savez(tmp_path / "a.npz", **arrays_of(smooth()))
    found = load_transport(tmp_path / "a.npz")
    assert same(replace(found, provenance=smooth().provenance), smooth())
    assert found.provenance == {"scene": "x"}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"format": np.array("domesim transport 2")},
            "'domesim transport 1', got domesim .* 2",
        ),
        ({"dome": np.array([-3.0, 1, 0, 1, np.nan])}, "radius must be above 0"),
        ({"provenance": np.array("not JSON")}, "this is none or damaged"),
        ({"core": np.zeros((3, 2, 2))}, r"core must be \(3, 6, 6\), got \(3, 2, 2\)"),
        ({"ambient": np.zeros((3, 9, 9))}, r"ambient must be \(3, 21, 21\)"),
        ({"core_error": np.full((3, 6, 6), np.nan)}, "core_error has values that are not finite"),
    ],
)
def test_a_file_with_nonsense_in_it_is_refused(
    changes: dict[str, Any], message: str, tmp_path: Path
) -> None:
    np.savez(tmp_path / "a.npz", **arrays_of(smooth(), **changes))
    with pytest.raises(InputError, match=message):
        load_transport(tmp_path / "a.npz")


@pytest.mark.parametrize("name", ["core", "provenance"])
def test_a_file_that_was_tampered_with_is_refused(name: str, tmp_path: Path) -> None:
    """Its zip checksums fit, its own does not."""
    arrays = arrays_of(smooth())
    array = np.ascontiguousarray(arrays[name])
    raw = bytearray(array.tobytes())
    raw[0] ^= 1
    arrays[name] = np.frombuffer(bytes(raw), array.dtype).reshape(array.shape)
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(InputError, match="damaged"):
        load_transport(tmp_path / "a.npz")


# Modes


def test_nodes_carry_cubics_exactly() -> None:
    nodes = 13
    at = np.linspace(-1, 1, 29)
    weights = interpolation(at, nodes)
    assert weights.sum(0) == pytest.approx(1, rel=1e-12)
    places = node_places(nodes)
    assert places[MARGIN] == pytest.approx(-1)
    assert places[-1 - MARGIN] == pytest.approx(1)
    for coefficients in ([1.0, 0, 0, 0], [0, 1, 0, 0], [0.3, -2, 1, 0.7], [0, 0, 0, 1]):
        cubic = np.polynomial.Polynomial(coefficients)
        assert weights.T @ cubic(places) == pytest.approx(cubic(at), abs=1e-12)
    table = np.polynomial.Polynomial([1, 2, 0, -1])(places)[:, None] * (places**2 - places)
    found = sample_nodes(table[None], at[:, None].repeat(29, 1).ravel(), np.tile(at, 29))[0]
    u, v = np.meshgrid(at, at, indexing="ij")
    assert found == pytest.approx(((1 + 2 * v - v**3) * (u**2 - u)).ravel(), abs=1e-12)


@every_dome
def test_the_best_approximation_of_each_rank(dome: Dome) -> None:
    """Eckart-Young: by its tail of singular values, for a core that primaries share."""
    stored = smooth(dome)
    shared = stored.core[0] + stored.core[0].T
    stored = replace(stored, core=shared * np.array([1.0, 0.5, 2.0])[:, None, None])
    whole = dense(stored, 0)
    values = np.linalg.svd(whole, compute_uv=False)
    errors = []
    for rank in range(1, stored.rank):
        few = stored.reduced(1e-14, rank)
        assert few.rank == rank
        tail = np.sqrt(np.sum(values[rank:] ** 2))
        errors.append(np.linalg.norm(dense(few, 0) - whole))
        assert errors[-1] == pytest.approx(tail, rel=1e-4)
        assert np.linalg.norm(dense(few, 2) - 2 * whole) == pytest.approx(2 * tail, rel=1e-4)
    assert (np.diff(errors) < 0).all()


@pytest.mark.parametrize("tolerance", [0.5, 0.1, 1e-2, 1e-3])
def test_a_reduced_transport_is_as_near_as_it_was_told(tolerance: float) -> None:
    """Each side of each core drops at most that share."""
    stored = smooth(degree=3)
    decay = np.exp(-np.arange(stored.rank))
    stored = replace(stored, core=stored.core * decay[:, None] * decay)
    few = stored.reduced(tolerance)
    assert few.rank < stored.rank
    square = [(np.sum((dense(few, p) - dense(stored, p)) ** 2)) for p in range(3)]
    whole = [np.sum(dense(stored, p) ** 2) for p in range(3)]
    assert np.sqrt(sum(square) / sum(whole)) <= np.sqrt(2) * tolerance
    assert stored.reduced(tolerance, 1).rank == 1
    assert stored.reduced(tolerance / 30).rank > few.rank


@every_dome
def test_reduced_by_next_to_nothing_it_acts_alike(dome: Dome) -> None:
    stored = smooth(dome)
    twice = replace(
        stored,
        modes=np.concatenate([stored.modes, stored.modes[1:2] - 2 * stored.modes[2:3]]),
        core=np.pad(stored.core, ((0, 0), (0, 1), (0, 1)), constant_values=0.1),
        core_error=np.pad(stored.core_error, ((0, 0), (0, 1), (0, 1))),
    )
    few = twice.reduced(1e-7)
    assert few.rank == stored.rank  # the mode that is a mixture of others is gone
    for one, other in ((stored, stored.reduced(1e-12)), (twice, few)):
        x = light(9)
        seen, expected = (each.observation(9, 9).linear(x) for each in (other, one))
        assert seen == pytest.approx(expected, abs=1e-6 if one is twice else 1e-11)
        assert other.mean_gain() == pytest.approx(one.mean_gain(), abs=1e-6)


def test_a_black_screens_transport_can_be_reduced() -> None:
    few = bare(CAP, (0.0, 0.0, 0.0)).reduced()
    assert few.rank == 1
    assert few.observation(5, 5).low_rank().linear(light(5)) == pytest.approx(light(5))


def test_the_relative_error_is_that_of_a_white_picture() -> None:
    one = bare(CAP, (0.3, 0.5, 0.4))
    one = replace(one, core_error=one.core * np.array([0.01, 0.02, 0.015])[:, None, None])
    assert one.relative_error() == pytest.approx(0.02)
    assert one.reduced().relative_error() == pytest.approx(0.02)
    stored = smooth()
    random = np.random.default_rng(1)
    u, v, areas = disc_quadrature(stored.dome, 20)
    modes = sample_nodes(stored.modes, u, v)
    share = areas / areas.sum()
    white = modes @ share
    square = np.zeros(3)
    for _ in range(400):
        wrong = stored.core_error * random.standard_normal(stored.core.shape)
        square += ((wrong @ white) @ modes) ** 2 @ share / 400
    expected = np.sqrt(square) / stored.mean_gain()
    assert stored.relative_error() == pytest.approx(expected.max(), rel=0.1)


@every_dome
def test_the_mean_gain_is_that_of_a_white_picture(dome: Dome) -> None:
    stored, size = smooth(dome), 101
    white = np.ones((1, size, size, 3))
    pollution = (stored.observation(size, size).linear(white) - white)[0]
    areas = dome.screen_areas(size, size)
    mean = np.einsum("rc,rcp->p", areas, pollution) / areas.sum()
    assert mean == pytest.approx(stored.mean_gain(), rel=3e-3)
    assert stored.mean_gain() == pytest.approx(stored.core[:, 0, 0], rel=1e-3)  # mode 0's


@every_dome
def test_a_sum_adds_the_pollutions(dome: Dome) -> None:
    one, other = smooth(dome, 1), smooth(dome, 2, seed=1)
    both = one.plus(other)
    x = light(9)
    parts = [each.observation(9, 9).linear(x) - x for each in (both, one, other)]
    assert parts[0] == pytest.approx(parts[1] + parts[2], abs=1e-9)
    assert both.ambient == pytest.approx(one.ambient + other.ambient)
    assert both.modes[0] == pytest.approx(1)
    assert both.rank == other.rank  # the planes are among the parabolas
    errors = [each.core_error[:, 0, 0] for each in (both, one, other)]
    assert (errors[0] >= 0.999 * np.hypot(errors[1], errors[2])).all()
    pair = bare(dome, (0.1, 0.2, 0.3)), bare(dome, (0.3, 0.3, 0.3))
    added = pair[0].plus(pair[1])
    assert added.core == pytest.approx(pair[0].core + pair[1].core)
    with pytest.raises(InputError, match="different screens or grids"):
        one.plus(smooth(replace(dome, radius=9.0)))
    with pytest.raises(InputError, match="different screens or grids"):
        one.plus(smooth(dome, nodes=23))


# Observations


@pytest.mark.parametrize("size", [5, 7, 33])
@pytest.mark.parametrize("name", DOMES)
def test_a_bare_cap_is_the_closed_form(name: str, size: int) -> None:
    dome, albedo = DOMES[name], (0.7, 0.3, 0.0)
    gain = 0.5 + np.random.default_rng(4).random((size, size))
    for lens_gain in (None, gain):
        found = bare(dome, albedo).observation(size, size, lens_gain=lens_gain, ambient=0.03)
        closed = ClosedFormDome(dome, size, size, albedo=albedo, lens_gain=lens_gain, ambient=0.03)
        few = found.low_rank()
        x, y = light(size), light(size, 1)
        assert found.shape == closed.shape
        for each in (found, few):
            assert (each.screen == closed.screen).all()
            assert each.observe(x) == pytest.approx(closed.observe(x), abs=1e-10)
            assert each.direct(x) == pytest.approx(closed.direct(x), abs=1e-10)
            assert each.adjoint(y) == pytest.approx(closed.adjoint(y), abs=1e-10)


@every_dome
@pytest.mark.parametrize("size", [6, 11])
def test_an_observation_is_its_sum(dome: Dome, size: int) -> None:
    """phi(x)[i] = sum_jk B_j(i) core_jk sum_l a_l B_k(l) g_l x_l / A_s, without any nodes."""
    stored = smooth(dome, nodes=97)
    gain = 0.5 + np.random.default_rng(4).random((size, size))
    centres = (np.arange(size) + 0.5) * 2 / size - 1
    modes = ScreenBasis(dome, 2).at(*np.meshgrid(centres, centres))
    screen, areas = dome.inside(size, size), dome.screen_areas(size, size)
    x = light(size)
    collected = np.einsum("krc,rc,rcp->pk", modes, areas * gain, x[0]) / dome.screen_area
    excited = np.einsum("pjk,pk->pj", stored.core, collected)
    pollution = np.einsum("jrc,pj->rcp", modes, excited) * screen[..., None]
    direct = x[0] * np.where(screen, gain, 1)[..., None]
    seen = stored.observation(size, size, lens_gain=gain).linear(x)[0]
    assert seen == pytest.approx(direct + pollution, abs=1e-4)


def test_ambient_light_is_on_the_screen_only() -> None:
    stored, size = smooth(), 15
    observation = stored.observation(size, size, ambient=0.05)
    black = observation.observe(np.zeros((1, size, size, 3)))[0]
    centres = (np.arange(size) + 0.5) * 2 / size - 1
    u, v = np.meshgrid(centres, centres)
    lamps = sample_nodes(stored.ambient, u.ravel(), v.ravel()).reshape(3, size, size)
    screen = stored.dome.inside(size, size)
    assert (black[~screen] == 0).all()
    assert black[screen] == pytest.approx(np.moveaxis(lamps + 0.05, 0, -1)[screen], abs=1e-12)
    assert observation.low_rank().observe(np.zeros((1, size, size, 3)))[0] == pytest.approx(black)


@every_dome
def test_few_modes_see_what_all_see(dome: Dome) -> None:
    stored = smooth(dome, 3)
    decay = np.exp(-1.5 * np.arange(stored.rank))
    stored = replace(stored, core=stored.core * decay[:, None] * decay)
    tabulated = stored.observation(13, 13, lens_gain=0.7 + 0.1 * light(13)[0, :, :, 0])
    x = light(13)
    scale = np.abs(tabulated.linear(x) - tabulated.direct(x)).max()
    ranks = []
    for tolerance in (1e-1, 1e-2, 1e-4):
        few = tabulated.low_rank(tolerance, stored.rank)
        ranks.append(len(few.factors.spread))
        assert few.linear(x) == pytest.approx(tabulated.linear(x), abs=3 * tolerance * scale)
        assert few.observe(x) - few.linear(x) == pytest.approx(
            tabulated.observe(x) - tabulated.linear(x), abs=1e-12
        )
    assert ranks[0] < ranks[1] < ranks[2] < stored.rank
    assert len(tabulated.low_rank(1e-12, 2).factors.spread) == 2


@every_dome
def test_a_lens_dims_light_before_it_bounces(dome: Dome) -> None:
    size = 9
    gain = 0.5 + np.random.default_rng(4).random((size, size))
    stored, x = smooth(dome), light(size)
    on = dome.inside(size, size)[..., None]
    lit = np.where(on, gain[..., None] * x, x)
    plain = stored.observation(size, size)
    with_lens = stored.observation(size, size, lens_gain=gain)
    assert with_lens.linear(x) == pytest.approx(plain.linear(lit), abs=1e-12)
    # Seen at a slant, direct light differs; what bounces does not.
    glossy = stored.observation(size, size, lens_gain=gain, seen_gain=2 * gain)
    extra = np.where(on, gain[..., None] * x, 0)
    assert glossy.linear(x) == pytest.approx(with_lens.linear(x) + extra, abs=1e-12)
    few = glossy.low_rank(1e-12, 12)
    assert few.linear(x) == pytest.approx(glossy.linear(x), abs=1e-11)
    assert (with_lens.linear(x)[0][~on[..., 0]] == x[0][~on[..., 0]]).all()


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan])
def test_a_lens_that_leaves_the_screen_dark_is_refused(bad: float) -> None:
    gain = np.ones((6, 6))
    gain[0, 0] = bad  # off the screen it does not matter
    found, plain = (smooth().observation(6, 6, lens_gain=each) for each in (gain, None))
    assert found.linear(light(6)) == pytest.approx(plain.linear(light(6)))
    gain[3, 3] = bad
    for gains in ({"lens_gain": gain}, {"seen_gain": gain}):
        with pytest.raises(InputError, match="lens gain must be above 0 everywhere"):
            smooth().observation(6, 6, **gains)


def test_a_part_of_a_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    smooth(degree=1, nodes=7).save(path)
    raw = path.read_bytes()
    for length in [*range(0, len(raw), len(raw) // 40), len(raw) - 1]:
        path.write_bytes(raw[:length])
        with pytest.raises(InputError, match=r"a\.npz"):
            load_transport(path)
