"""The laboratory of experiments that measure virtual theatres."""

from __future__ import annotations

import numpy as np

from domesim.measure.dome.camera import domemaster_camera
from domesim.room.dome import Dome
from domesim.room.theatre import Theatre
from testing.laboratory import Faults, patterns_for, photographed


def test_photographs_have_the_faults_that_are_asked_for():
    theatre = Theatre(Dome(3.0, np.pi / 2), (0.4, 0.4, 0.4))
    patterns = patterns_for(theatre.dome, 32)[:2]
    camera = domemaster_camera(theatre)
    faults = Faults(noise=0.05, gain=(1.0, 2.0, 0.5), vignetting=0.2)
    seen = photographed(theatre, camera, patterns, faults, size=48, walks=64, seed=1)
    black, white = seen.light
    inside = theatre.dome.inside(48, 48)
    assert black[inside].max() < 0.01
    assert white[~inside].max() == 0
    u, v = np.meshgrid(*[(2 * np.arange(48) - 47) / 48] * 2)
    # White is lit by itself: 1 + (rho / 2) / (1 - rho / 2)
    wanted = np.array(faults.gain) * 1.25 * (1 - 0.2 * (u**2 + v**2))[..., None]
    off = (white / wanted - 1)[inside]
    assert abs(off.mean()) < 0.003
    assert 0.045 < off.std() < 0.07
