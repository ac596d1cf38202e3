"""Scenes of any pollution and luminance of white: a dome, and a stereo cinema."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from domesim.observation.crosstalk import leak_matrices
from domesim.scene import DomeScene, StereoScene, load_scene

DOME_SCENE = "dome_hemisphere"
STEREO_SCENE = "stereo_polarised_paper"
"""Where inputs are shown, with other figures of theirs."""
SEQUENTIAL_CONTRAST = 2000.0
"""White over black: the least of the reference projector in SMPTE RP 431-2:2011 (doi
10.5594/SMPTE.RP431-2.2011), which allows theatres less."""
ADAPTATION = 0.1
"""Adaptation luminance over that of white."""


def stereo_at(crosstalk: float, white: float) -> StereoScene:
    """The stereo scene with that crosstalk at all seats, and that luminance of white, cd/m²."""
    scene = scene_at(crosstalk)
    black = white / SEQUENTIAL_CONTRAST
    return replace(
        scene,
        projector=replace(scene.projector, white=white, black=black),
        ambient=np.full((2, 3), black),
        viewing=replace(scene.viewing, adaptation=ADAPTATION * white),
    )


def dome_at(albedo: float, white: float) -> DomeScene:
    """The dome with that albedo for all primaries, and that luminance of white, cd/m²."""
    scene = load_scene(DOME_SCENE)
    assert isinstance(scene, DomeScene)
    black = white / SEQUENTIAL_CONTRAST
    return replace(
        scene,
        theatre=replace(scene.theatre, albedo=(albedo,) * 3),
        projector=replace(scene.projector, white=white, black=black),
        ambient=black,
        viewing=replace(scene.viewing, adaptation=ADAPTATION * white),
    )


def scene_at(crosstalk: float) -> StereoScene:
    """The scene with that share of light reaching the other eye, at all seats."""
    scene = load_scene(STEREO_SCENE)
    assert isinstance(scene, StereoScene)
    matrices = leak_matrices(crosstalk)
    seats = {name: replace(seat, matrices=matrices) for name, seat in scene.seats.items()}
    return replace(scene, seats=seats)
