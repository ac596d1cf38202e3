"""How the compare page stores light: how large it is, and how exact."""

from __future__ import annotations

import base64
import zlib

import numpy as np
import pytest

from compensate.page.packing import FINEST, LEAST, PER_OCTAVE, Packed, pack, packed_map

SIDE = 96
MASK = np.hypot(*(np.mgrid[:SIDE, :SIDE] + 0.5 - SIDE / 2)) < SIDE / 2


def noise(seed: int = 3) -> np.ndarray:
    """Light over four decades without any structure."""
    rng = np.random.default_rng(seed)
    return (10 ** rng.uniform(-4, 0, (SIDE, SIDE, 3))).astype(np.float32)


def size(packed: Packed) -> int:
    return sum(map(len, packed.payloads))


@pytest.mark.parametrize("room", [1e9, 70_000, 50_000])
def test_it_fits_into_the_room_that_there_is(room: float) -> None:
    packed = pack([noise(), noise() + np.float32(0.05)], MASK, 1, room)
    assert size(packed) <= room
    assert (packed.top == FINEST) == (room == 1e9)


def test_it_takes_the_finest_codes_that_fit() -> None:
    """Codes finer by the root of 2 would not."""
    packed = pack([noise(), noise() + np.float32(0.05)], MASK, 1, 60_000)
    finer = pack([noise(), noise() + np.float32(0.05)], MASK, 1, 60_000 * 1.2)
    assert finer.top > packed.top > 300


def test_where_nothing_fits_codes_are_coarse_and_the_picture_is_there() -> None:
    packed = pack([noise()], MASK, 1, 10)
    assert packed.top == round(FINEST / 2**8)
    assert packed.error(1.0) < 0.02


@pytest.mark.parametrize(
    "seen",
    [
        lambda m: m + np.float32(0.05),
        lambda m: 0.7 * m + np.float32(0.1),
        lambda m: np.maximum(m, np.float32([0.02, 0.03, 0.05])),
        lambda m: m * np.linspace(0.5, 1, SIDE, dtype=np.float32)[:, None, None],
    ],
    ids=["a veil", "raised", "clipped at black", "shaded"],
)
def test_what_is_the_masters_light_but_for_a_veil_costs_next_to_nothing(seen) -> None:
    alone = size(pack([noise()], MASK, 1, 1e9))
    top = pack([noise()], MASK, 1, alone / 3).top
    room = size(pack([noise()], MASK, 1, alone / 3))
    both = pack([noise(), seen(noise())], MASK, 1, 1.15 * room)
    assert both.top >= top / 1.5
    assert both.bases == ((), (0,))


def test_the_other_eyes_ghost_is_predicted_from_both_eyes() -> None:
    left, right = noise(), noise(4)
    seen = [left + np.float32(0.05) * right, right + np.float32(0.05) * left]
    packed = pack([left, right, *seen], MASK, 2, 80_000)
    assert packed.bases == ((), (), (0, 1), (1, 0))
    assert sum(map(len, packed.payloads[2:])) < 0.1 * size(packed)


def test_a_map_is_within_half_a_code() -> None:
    wanted = 2 ** np.random.default_rng(0).uniform(-3, 9, (5, 7)).astype(np.float32)
    codes = zlib.decompress(base64.b64decode(packed_map(wanted, np.ones((5, 7), bool))))
    steps = np.frombuffer(codes, np.uint8).reshape(5, 7)
    found = LEAST * 2 ** ((np.cumsum(steps, axis=1, dtype=np.uint8) - 1.0) / PER_OCTAVE)
    np.testing.assert_allclose(found, wanted, rtol=2 ** (0.5 / PER_OCTAVE) - 1 + 1e-6)
