"""Frames that were made for a guessed albedo are judged where it is another one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from foreseeing import night, posed_in

from compensate.figures import Appraisal
from compensate.solve import solved
from compensate.unmeasured import OFF, Truth, Unmeasured, unmeasured
from domesim.observation.spherical import bare_transport
from domesim.scene import load_scene
from domesim.scene.loading import scene_content

SIZE = 64


@pytest.fixture
def planetarium():
    return load_scene("dome_planetarium")


def of_albedo(albedo):
    """The planetarium as a scene file of another albedo has it."""
    content = scene_content("dome_planetarium")
    content["screen"]["albedo"] = albedo
    return load_scene(content)


@pytest.mark.parametrize("times", [1 - OFF, 1.0, 1 + OFF])
def test_a_theatre_of_another_albedo_is_the_one_that_a_file_describes(planetarium, times):
    other = planetarium.with_albedo(times)
    filed = of_albedo([times * rho for rho in planetarium.theatre.albedo])
    light = night(planetarium, SIZE, SIZE)
    assert other.projector == planetarium.projector
    np.testing.assert_allclose(
        other.observation(SIZE, SIZE).observe(light),
        filed.observation(SIZE, SIZE).observe(light),
        rtol=1e-6,
    )


def test_a_stored_transport_is_scaled_as_the_bare_screen_reflects(planetarium):
    bare = replace(planetarium, transport=bare_transport(planetarium.theatre))
    light = night(planetarium, SIZE, SIZE)
    seen = bare.with_albedo(0.7).observation(SIZE, SIZE).observe(light)
    wanted = planetarium.with_albedo(0.7).observation(SIZE, SIZE).observe(light)
    np.testing.assert_allclose(seen, wanted, rtol=1e-5, atol=1e-7)


def test_no_screen_becomes_whiter_than_paint():
    assert of_albedo(0.9).with_albedo(1.3).theatre.albedo == pytest.approx((0.95,) * 3)
    assert of_albedo(0.97).with_albedo(1.3).theatre.albedo == pytest.approx((0.97,) * 3)


def test_each_truth_is_what_that_theatre_shows(planetarium):
    posed = posed_in(planetarium, night(planetarium, SIZE, SIZE))
    made = solved(posed, "perceptual").light
    found = unmeasured(posed, made)
    for truth, times in zip(found.truths, (1 - OFF, 1, 1 + OFF), strict=True):
        theatre = of_albedo([times * rho for rho in planetarium.theatre.albedo])
        there = posed_in(theatre, posed.desired)
        loss = Appraisal(there).loss
        own = solved(there, "perceptual").light
        assert truth.albedo == pytest.approx(float(np.mean(theatre.albedo)))
        assert (truth.untouched, truth.guessed, truth.known) == pytest.approx(
            (loss(posed.desired), loss(made), loss(own)), abs=2e-3
        )
    assert found.lost == (found.truths[0].guessed, found.truths[2].guessed)
    assert found.truths[1].guessed == found.truths[1].known


def test_what_was_measured_is_not_guessed(planetarium):
    measured = replace(bare_transport(planetarium.theatre), provenance={"measured": "survey.toml"})
    posed = posed_in(replace(planetarium, transport=measured), night(planetarium, SIZE, SIZE))
    assert unmeasured(posed, posed.desired) is None
    pair = load_scene("stereo_polarised_paper")
    posed = posed_in(pair, night(pair, SIZE, SIZE))
    assert unmeasured(posed, posed.desired) is None


@pytest.mark.parametrize(
    ("untouched", "guessed", "worth"),
    [(0.5, 0.4, True), (0.5, 0.49, False), (0.3, 0.4, False), (0.001, 0.01, True)],
)
def test_it_is_worth_doing_where_frames_gain_at_every_albedo(untouched, guessed, worth):
    good = Truth(0.4, 1.0, 0.5, 0.5)
    doubtful = Truth(0.3, untouched, guessed, min(guessed, 0.35))
    found = Unmeasured((doubtful, good, Truth(0.5, 2.0, 0.6, 0.6)))
    assert found.worth_doing is worth
    told = found.told("this picture")
    assert ("worth doing unmeasured" in told) is worth
    assert ("measure first" in told) is not worth
    regains = guessed - min(guessed, 0.35) >= 0.02
    assert ("to measure it would gain up to" in told) is regains


@pytest.mark.long
def test_check_says_it(run):
    told = run("scene", "check", "dome_planetarium", "--json").figures()["unmeasured"]
    assert [round(truth["albedo"], 3) for truth in told["truths"]] == [0.318, 0.455, 0.591]
