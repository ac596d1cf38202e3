"""A screen's gain lobe: our formula and Mitsuba's BSDF are one."""

from __future__ import annotations

import numpy as np
import pytest

from domesim.pathtrace.llvm import load_mitsuba
from domesim.pathtrace.machine import DrJit
from domesim.pathtrace.sources import GainLobe
from domesim.room.lenses import lobe_gain
from domesim.room.theatre import Lobe


@pytest.mark.parametrize("lobe", [Lobe(0.3, 0.3), Lobe(1.0, 0.1), Lobe(0.1, 0.9), Lobe(0.0, 0.5)])
def test_gain_is_mitsubas(lobe):
    random = np.random.default_rng(2)
    normal, to_eye, to_light = random.standard_normal((3, 500, 3))
    normal, to_eye, to_light = (
        v / np.linalg.norm(v, axis=-1, keepdims=True) for v in (normal, to_eye, to_light)
    )
    ours = lobe_gain(lobe, normal, to_eye, to_light)
    machine = DrJit(load_mitsuba())
    vectors = [
        tuple(machine.lanes(np.ascontiguousarray(v[:, k])) for k in range(3))
        for v in (normal, to_eye, to_light)
    ]
    theirs = machine.array(GainLobe(machine, lobe).gain(*vectors, vectors[0][0] < 2))
    cosines = np.minimum(np.sum(normal * to_eye, -1), np.sum(normal * to_light, -1))
    clear = np.abs(cosines) > 0.02  # float32 near the horizon
    np.testing.assert_allclose(ours[clear], theirs[clear], rtol=2e-3, atol=1e-5)
    assert (ours[cosines < 0] == 0).all()
    assert clear.sum() > 400


def test_a_lobe_makes_no_light():
    """Directional albedo by quadrature: the rougher, the more single reflections go astray."""
    theta, phi = np.meshgrid(*(np.linspace(0, end, 801) for end in (np.pi / 2, 2 * np.pi)))
    sine = np.sin(theta)
    to_light = np.stack([sine * np.cos(phi), sine * np.sin(phi), np.cos(theta)], -1)
    normal = np.broadcast_to([0.0, 0, 1], to_light.shape)
    step = (np.pi / 2 / 800) * (2 * np.pi / 800)
    kept = [
        np.sum(lobe_gain(Lobe(1.0, rough), normal, normal, to_light) * np.cos(theta) * sine) * step
        for rough in (0.1, 0.3, 0.6, 1.0)
    ]
    assert np.pi * 1.002 > kept[0] > np.pi * 0.97
    assert np.all(np.diff(kept) < 0)
