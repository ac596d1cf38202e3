"""Energy balances: what projectors emit is what all surfaces absorb and what leaves the theatre."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import made_up_domes
import numpy as np
import pytest
import survey_rooms
from rooms import BEFORE, ROOMS, THEATRES, room

from domesim.room.theatre import Theatre
from domesim.scene import load_scene
from domesim.scene.dome import DomeScene
from testing import energy
from testing.energy import imbalance


def bundled(name: str) -> Theatre:
    scene = load_scene(name)
    assert isinstance(scene, DomeScene)
    return scene.theatre


BALANCED: dict[str, Callable[[], Theatre]] = {
    **{name: lambda each=each: each for name, each in (BEFORE | ROOMS).items()},  # type: ignore[misc]
    **{
        name: lambda name=name: replace(THEATRES[name], lenses=())  # type: ignore[misc]
        for name in THEATRES
        # Its wall has no height, its cavity no depth.
        if name != "nothing to see"
    },
    "booth": room,
    "survey": lambda: survey_rooms.THEATRE,
    "made up": lambda: made_up_domes.THEATRE,
    **{
        name: lambda name=name: bundled(name)  # type: ignore[misc]
        for name in ("dome_planetarium", "dome_imax", "dome_led", "dome_dark", "dome_hemisphere")
    },
}
QUICK = ("floor in the beam", "hiding", "cavity")


@pytest.mark.parametrize("name", QUICK)
def test_energy_balances(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(energy, "LANES", 1 << 11)
    off, error = imbalance(BALANCED[name](), 6e-3)
    assert error.max() < 6e-3
    assert np.all(np.abs(off) < 3.5 * error)


@pytest.mark.long
@pytest.mark.parametrize("name", BALANCED)
def test_energy_balances_to_two_thousandths(name: str) -> None:
    off, error = imbalance(BALANCED[name](), 2e-3)
    assert error.max() < 2e-3
    assert np.all(np.abs(off) < 3.5 * error)
