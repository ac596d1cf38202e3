"""Polarised light in domes against the closed form, and bounces shared out between eyes."""

from __future__ import annotations

import numpy as np
import pytest

from domesim.observation.crosstalk import Crosstalk
from domesim.observation.dome_pair import dome_pair
from domesim.observation.spherical import ClosedFormDome, closed_form_gain
from domesim.pathtrace.polarised_dome import polarised_dome
from domesim.pathtrace.two_eyes import seen_by_eyes
from domesim.room.dome import Dome

LENS, EYE = (0.3, -0.2, 1.2), (-0.5, 0.4, 1.0)


def test_each_reflection_keeps_its_share_of_circular_polarisation():
    dome, albedo, kept = Dome(3.0, np.radians(80)), 0.6, -0.7
    random = np.random.default_rng(4)
    height = np.cos(dome.half_angle) + (1 - np.cos(dome.half_angle)) * random.random(4096)
    azimuth, aside = 2 * np.pi * random.random(4096), np.sqrt(1 - height**2)
    places = 3.0 * np.stack([aside * np.cos(azimuth), aside * np.sin(azimuth), height], axis=1)
    found = polarised_dome(dome, (albedo, kept), LENS, EYE, places, samples=16, seed=1)
    direct = found.direct[:, 0].mean()
    # The whole screen's flux, by many more places than are traced
    at = (
        np.cos(dome.half_angle) + (1 - np.cos(dome.half_angle)) * (np.arange(1 << 20) + 0.5) / 2**20
    )
    turn, off = 2 * np.pi * 0.6180339887 * np.arange(1 << 20), np.sqrt(1 - at**2)
    way = 3.0 * np.stack([off * np.cos(turn), off * np.sin(turn), at], 1) - np.asarray(LENS)
    distance = np.linalg.norm(way, axis=1)
    inward = np.sum(way * (way + np.asarray(LENS)), axis=1) / 3.0 / distance
    white = np.mean(inward / distance**2) / 2 * dome.screen_area
    for part, (k, sign) in enumerate(((1.0, 1.0), (kept, -kept))):
        gain = closed_form_gain(albedo, 3.0, dome.screen_area, k) * albedo / np.pi
        expected = sign * (direct + gain * white)
        error = np.sqrt(np.sum(found.error[:, part] ** 2)) / len(places)
        assert abs(found.all[:, part].mean() - expected) < 4 * error + 3e-4 * direct
    # But for places behind the lens, as the eye sees it
    off = np.abs(found.direct[:, 1] + kept * found.direct[:, 0])
    assert np.percentile(off, 99) < 1e-4 * direct


@pytest.mark.parametrize("kept", [1.0, 0.0, -0.6])
def test_bounces_shared_out_are_the_closed_form(kept):
    """With the series of bounces in place of tracing."""
    size, rho, leaks = 24, 0.7, np.stack([0.02 * np.eye(3), np.diag([0.01, 0.03, 0.05])])
    dome = Dome(3.0, np.radians(100))
    closed = ClosedFormDome(dome, size, size, albedo=rho)
    random = np.random.default_rng(2)
    light = random.random((2, size, size, 3)) * closed.screen[None, :, :, None]
    once = rho / (4 * np.pi * 9.0)
    ratio = once * dome.screen_area
    layers = []
    for view in light:
        flux = np.einsum("rc,rcp->p", dome.kept_areas(size, size), view)
        on = closed.screen[..., None]
        bounces = {f"bounce{k}": once * ratio ** (k - 1) * flux * on for k in range(1, 60)}
        indirect = sum(bounces.values())
        layers.append({"direct": view, "indirect": indirect, "variance": 0 * view, **bounces})
    seen = seen_by_eyes((layers[0], layers[1]), kept, leaks)
    differing = ClosedFormDome(dome, size, size, albedo=rho, kept=kept)
    expected = dome_pair(closed, differing, Crosstalk(size, size, leaks)).observe(light)
    assert np.stack([each[""] for each in seen]) == pytest.approx(expected, abs=1e-6)
