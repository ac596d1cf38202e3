"""The engine's entry: a master in, the frame to project out, in its own encoding."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from compensated import compensate_frame
from theatres import DATA, needs_data

from compensate.commands.aiming import Aiming
from compensate.figures import Appraisal
from compensate.master import compensate
from compensate.methods import COMMON as METHODS
from compensate.pose import pose
from compensate.solver.accelerated import Accelerated
from compensate.solver.admm import ADMM
from compensate.solver.result import Status
from domesim.errors import InputError
from domesim.frames import (
    ColourTag,
    Frame,
    Master,
    read_frame,
    read_master,
    write_frame,
    write_master,
)
from domesim.observation.projector import Projector
from domesim.room.theatre import Theatre
from domesim.scene import load_scene
from domesim.scene.choice import SceneChoice
from domesim.scene.screening import decoded
from testing.masters import night

SRGB = ColourTag("srgb", "BT.709", "the test")


def frame(size: int = 96, bits: int = 8, seed: int = 0) -> Master:
    """A dark sky with a bright building, and content in the corners off the screen."""
    random = np.random.default_rng(seed)
    pixels = 0.2 * random.random((size, size, 3), np.float32)
    pixels[size // 2 : size * 3 // 4, size // 3 : size * 2 // 3] = 1.0
    levels = 2**bits - 1
    codes = np.rint(pixels * levels) / np.float32(levels)
    return Master((Frame(codes, Path("night.png"), SRGB, bits, False),))


@pytest.fixture(scope="module")
def scene():
    return load_scene("dome_imax")


@pytest.mark.parametrize("method", METHODS)
def test_a_frame_stays_in_range_and_off_the_screen_as_it_was(scene, method):
    master = frame()
    outcome = compensate_frame(master, scene, method=method)
    pixels, screen = outcome.frame.pixels, scene.dome.inside(96, 96)
    assert pixels.min() >= 0
    assert pixels.max() <= 1
    assert (pixels[:, ~screen] == master.pixels[:, ~screen]).all()
    changed = (pixels != master.pixels)[:, screen].any()
    assert changed == (method != "none")


def test_perception_decides(scene):
    figures = {
        method: compensate_frame(frame(), scene, method=method).figures for method in METHODS
    }
    best = figures["perceptual"]
    assert best.loss_after < max(best.loss_subtractive, best.loss_before)
    assert best.loss_after < figures["raised-black"].loss_after
    assert figures["none"].loss_after == pytest.approx(best.loss_before, rel=1e-6)
    assert figures["subtractive"].loss_after == pytest.approx(best.loss_subtractive, rel=1e-6)
    assert 0.3 < best.clipped < 1
    assert 0.2 < best.pollution < 2


def test_what_is_projected_is_what_the_solver_found(scene):
    """Encoding and decoding the result moves it by a code value's rounding, no more."""
    outcome = compensate_frame(frame(bits=16), scene)
    shown = decoded(outcome.frame, scene)
    screen = scene.dome.inside(96, 96)
    assert shown[0][screen] == pytest.approx(outcome.light[0][screen], abs=2e-5)


@pytest.mark.parametrize("value", [-0.1, 1.1, np.nan, np.inf])
def test_light_out_of_range_is_refused_on_the_screen_only(scene, value):
    light = np.full((1, 16, 16, 3), 0.5)
    light[0, 8, 8, 1] = value
    with pytest.raises(InputError, match=r"0..1 on the screen, got 1 values"):
        compensate(light, scene)
    light[0, 8, 8, 1] = 0.5
    light[0, 0, 0, 1] = 2.0
    assert compensate(light, scene).light[0, 0, 0, 1] == 2.0


def test_highlights_are_clipped_and_counted(scene):
    (one,) = frame(64).frames
    linear = ColourTag("linear", "BT.709", "the test")
    master = Master((replace(one, floating=True, bits=32, colour=linear),))
    pixels = master.pixels.copy()
    pixels[0, 40:44, 30:34] = 300.0
    outcome = compensate_frame(master.with_pixels(pixels), scene)
    screen = scene.dome.inside(64, 64)
    assert outcome.figures.out_of_range == pytest.approx(16 / screen.sum())
    assert outcome.frame.pixels[0, screen].max() <= 1


@pytest.mark.long
@needs_data
def test_a_2k_frame_within_3_gib_unchanged_off_the_screen(tmp_path):
    """The issue's job: one process, its peak memory, its frame; PNG, as JPEG smears the rim."""
    source = DATA / "dome" / "dm3d_fulldome_2K.jpg"
    master = tmp_path / "fulldome.png"
    write_frame(read_frame(source), master)
    command = [sys.executable, "-m", "domesim", "compensate", str(master)]
    command += ["--scene", "dome_imax", "--out", str(tmp_path / "out"), "--quiet"]
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    subprocess.run(command, check=True, timeout=300)
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    assert max(peak, before) * 1024 < 3 * 2**30
    was, now = (read_frame(path).pixels for path in (master, tmp_path / "out" / "fulldome.png"))
    outside = ~load_scene("dome_imax").dome.inside(2048, 2048)
    assert (was[outside] == now[outside]).all()
    assert (was != now).any()
    assert now.min() >= 0
    assert now.max() <= 1


def test_what_a_file_cannot_hold_is_told(scene):
    """A projector of a wide gamut may need colours that the master's encoding has not."""
    wide = replace(scene, projector=Projector("P3-D65", 13.7, 0.007))
    outcome = compensate_frame(frame(64), wide)
    assert outcome.figures.file_clipped > 0.05
    stored = outcome.appraisal.loss(decoded(outcome.frame, wide))
    assert stored != pytest.approx(outcome.figures.loss_after, rel=1e-3)
    assert compensate_frame(frame(64), scene).figures.file_clipped == 0


def test_the_loss_of_the_stored_file_is_told(scene, tmp_path):
    """Of its codes: with fewer bits it is further off what it would be without any rounding."""
    path, off = tmp_path / "out.png", {}
    for bits in (8, 16):
        outcome = compensate_frame(frame(96, bits), scene)
        write_master(outcome.frame, [path], bits=bits)
        stored = outcome.appraisal.loss(decoded(read_master([path]), scene))
        off[bits] = abs(stored / outcome.figures.loss_after - 1)
    assert off[16] < 0.1 * off[8]


def test_a_jpeg_changes_off_the_screen_by_its_own_rounding_only(scene, tmp_path):
    source, target = tmp_path / "m.jpg", tmp_path / "out.jpg"
    write_master(frame(256), [source])
    master = read_master([source])
    outcome = compensate_frame(master, scene, method="subtractive")
    write_master(outcome.frame, [target])
    off = ~scene.dome.inside(256, 256)
    assert (outcome.frame.pixels[:, off] == master.pixels[:, off]).all()
    change = np.abs(read_master([target]).pixels - master.pixels)[:, off] * 255
    assert change.max() <= 5


@pytest.mark.parametrize(("half_angle", "albedo"), [(60, 0.3), (90, 0.9), (170, 0.95)])
def test_every_dome_is_certified_within_a_hundred_iterations(half_angle, albedo):
    scene = load_scene("dome_hemisphere")
    dome = replace(scene.dome, half_angle=np.radians(half_angle))
    bare = Theatre(dome, (albedo,) * 3)
    scene = replace(scene, theatre=bare)
    result = compensate(night(96), scene, solver=ADMM(stop_when_invisible=False))
    assert result.status is Status.CONVERGED
    assert result.iterations <= 100


def test_nothing_certified_is_no_figure():
    """A solver without a certificate: no gap, and valid JSON."""
    solver = Accelerated(max_iterations=1)
    figures = compensate_frame(frame(48), load_scene("dome_imax"), solver=solver).figures
    assert figures.gap is None
    json.dumps(asdict(figures), allow_nan=False)


def test_the_certificate_is_told_in_just_noticeable_differences():
    """What an early stop shows is within it of what the optimum shows, by the weighting itself."""
    posed = pose(night(48), load_scene("dome_imax"))
    optimum = ADMM(tolerance=1e-7, max_iterations=2000, stop_when_invisible=False)(
        posed.problem, posed.subtractive
    )
    for steps in (2, 3, 5):
        early = ADMM(tolerance=1e-9, max_iterations=steps, stop_when_invisible=False)(
            posed.problem, posed.subtractive
        )
        seen, best = (
            posed.observation.observe(found.light.astype(np.float64)) for found in (early, optimum)
        )
        energy = posed.problem.weighting.energy(seen - best)
        white = posed.scene.projector.white / posed.scene.viewing.adaptation
        rms = np.sqrt(energy / posed.screen.sum()) * white * posed.problem.weighting.peak
        assert rms <= Appraisal(posed).distance(early)
        assert Appraisal(posed).distance(early) <= 10 * rms


def test_quality_is_a_tolerance():
    scene = SceneChoice("dome_imax")
    assert Aiming().recipe(scene).tolerance == 1e-3
    assert Aiming(quality=True).recipe(scene).tolerance == 1e-4
    assert Aiming(tolerance=0.01).recipe(scene).tolerance == 0.01
    with pytest.raises(InputError, match=r"--quality is --tolerance 1e-4, got --tolerance 0\.01"):
        Aiming(tolerance=0.01, quality=True).recipe(scene)
