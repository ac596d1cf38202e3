"""Steps between a master's codes: told where they are seen, and nowhere else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from compensate.steps import visible_steps
from domesim.frames import Frame, Master
from domesim.frames.colour import ColourTag
from domesim.light.transfer import named

WEIGHTS = np.array([0.2126, 0.7152, 0.0722])
SCREEN = np.ones((64, 64), bool)


def gradient(bits: int) -> Master:
    """Codes from 1 to 16 of 255, one more every fourth column."""
    codes = np.round((1 + np.arange(64) // 4) / 255 * (2**bits - 1)) / (2**bits - 1)
    pixels = np.broadcast_to(codes[None, :, None], (64, 64, 3)).astype(np.float32)
    tag = ColourTag("srgb", "BT.709", "a test")
    return Master((Frame(pixels, Path("made.png"), tag, bits, floating=False),))


def shown(veil: float) -> np.ndarray:
    """What is seen of the gradient over a veil."""
    light = named("srgb", white=1.0).decode(gradient(8).frames[0].pixels)
    return (light[None] + veil).astype(np.float32)


def test_steps_of_the_lowest_codes_are_seen_without_a_veil_and_not_under_one():
    bare, veiled = (visible_steps(gradient(8), shown(v), SCREEN, WEIGHTS) for v in (0.0, 0.05))
    # Of fifteen steps in 63 pairs of columns, those above 10 %: from code 1 to code 12. As many
    # pairs lie one below the other.
    assert 8 / 127 < bare <= 15 / 127
    assert veiled == 0


def test_steps_from_row_to_row_count_alike():
    across, down = gradient(8), gradient(8)
    down.frames[0].pixels[:] = across.frames[0].pixels.transpose(1, 0, 2).copy()
    light = shown(0.0)
    one, other = (
        visible_steps(master, each, SCREEN, WEIGHTS)
        for master, each in ((across, light), (down, light.transpose(0, 2, 1, 3)))
    )
    assert one == pytest.approx(other, rel=0.5)  # each fifth row is looked at


def test_finer_codes_and_the_rest_of_the_picture_are_not_asked():
    assert visible_steps(gradient(16), shown(0.0), SCREEN, WEIGHTS) == 0
    edge = gradient(8)
    edge.frames[0].pixels[:, 32:] = 0.8
    assert visible_steps(edge, shown(0.0), SCREEN, WEIGHTS) < visible_steps(
        gradient(8), shown(0.0), SCREEN, WEIGHTS
    )
    assert visible_steps(gradient(8), shown(0.0), ~SCREEN, WEIGHTS) == pytest.approx(0)
