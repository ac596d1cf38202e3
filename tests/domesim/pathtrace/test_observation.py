"""Path tracing as an observation: against the closed form, with errors that are what they say."""

from __future__ import annotations

import signal
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from rooms import ALBEDO, room

from domesim.errors import InputError
from domesim.observation.spherical import ClosedFormDome
from domesim.pathtrace import tracer as tracer_module
from domesim.pathtrace.machine import DrJit
from domesim.pathtrace.observation import Observed, PathTracedDome
from domesim.pathtrace.tracer import Settings, Status, Traced, Tracer
from domesim.room.dome import Dome
from domesim.room.rays import FLOOR, NOTHING, SCREEN, Room
from domesim.room.theatre import Floor, Lamp, Theatre

SIZE = 24
Floats = NDArray[np.float64]


def bare(half_angle_deg: float = 90.0) -> Theatre:
    return Theatre(Dome(5.0, np.radians(half_angle_deg), np.radians(20)), ALBEDO)


LAMP = Lamp("exit", (0.0, 4.5, -0.8), (0.4, 0.0, 0.0), (0.0, 0.0, 0.2), (100.0, 200.0, 50.0))


def picture(size: int = SIZE, seed: int = 0) -> Floats:
    """(1, row, col, primary): dark, with a bright side, a window, and light in the corners."""
    random = np.random.default_rng(seed)
    light = 0.05 * random.random((1, size, size, 3))
    light[:, :, size // 2 :] += (0.4, 0.2, 0.6)
    light[:, size // 4 : size // 3, size // 5 : size // 3] = (1.0, 0.3, 0.9)
    return light


@pytest.fixture(scope="module")
def tracer() -> Tracer:
    return Tracer(bare())


@pytest.fixture(scope="module")
def room_tracer() -> Tracer:
    return Tracer(room())


def traced(tracer: Tracer, light: Floats | None = None, /, **settings: Any) -> Observed:
    light = picture() if light is None else light
    return PathTracedDome(
        tracer.theatre, *light.shape[1:3], Settings(**settings), tracer=tracer
    ).trace(light)


def on_screen(theatre: Theatre, size: int = SIZE) -> NDArray[np.bool_]:
    return theatre.dome.inside(size, size)


def scores(found: Traced, truth: Floats, screen: NDArray[np.bool_]) -> Floats:
    """(pixel, primary): how many standard errors each estimate is off."""
    gap = found.mean.astype(np.float64)[screen] - truth[screen]
    return np.asarray(gap / found.standard_error[screen])


def assert_unbiased(found: Traced, truth: Floats, screen: NDArray[np.bool_]) -> None:
    """Pooled, and pixel by pixel; the walks of one pixel carry all primaries at once."""
    z = scores(found, truth, screen)
    pooled = z.mean(0) * np.sqrt(len(z))
    assert np.all(np.abs(pooled) < 4), pooled
    rms = np.sqrt(np.mean(z**2, axis=0))
    # Of n normal scores the rms is 1 within 1 / sqrt(2 n).
    assert np.all(np.abs(rms - 1) < 4 / np.sqrt(2 * len(z))), rms


# What is computed against what is known.


@pytest.mark.parametrize("half_angle", [60.0, 90.0, 130.0])
@pytest.mark.parametrize("aim", [True, False])
def test_an_uneven_picture_on_a_bare_dome_is_the_closed_form(half_angle: float, aim: bool) -> None:
    theatre = bare(half_angle)
    known = ClosedFormDome(theatre.dome, SIZE, SIZE, albedo=ALBEDO)
    truth = (known.observe(picture()) - known.direct(picture()))[0]
    found = traced(Tracer(theatre), error=0.02, least=256, seed=1, aim=aim)
    assert found.indirect.status is Status.CONVERGED
    assert_unbiased(found.indirect, truth, known.screen)


def test_the_check_above_sees_a_bias_of_two_percent(tracer: Tracer) -> None:
    known = ClosedFormDome(tracer.theatre.dome, SIZE, SIZE, albedo=ALBEDO)
    truth = (known.observe(picture()) - known.direct(picture()))[0]
    found = traced(tracer, error=0.02, least=256, seed=1).indirect
    assert_unbiased(found, truth, known.screen)
    with pytest.raises(AssertionError):
        assert_unbiased(replace(found, mean=found.mean * np.float32(1.02)), truth, known.screen)
    for wrong in (0.7, 1.4):
        error = found.standard_error * np.float32(wrong)
        with pytest.raises(AssertionError):
            assert_unbiased(replace(found, standard_error=error), truth, known.screen)


def test_standard_errors_are_those_of_repetitions(room_tracer: Tracer) -> None:
    """Where nothing is known: sixteen seeds spread as each of them says."""
    screen = on_screen(room_tracer.theatre)
    runs = [traced(room_tracer, least=64, most=64, seed=seed).indirect for seed in range(16)]
    means = np.stack([run.mean[screen] for run in runs]).astype(np.float64)
    told = np.mean([run.standard_error[screen].astype(np.float64) ** 2 for run in runs], axis=0)
    ratio = means.var(axis=0, ddof=1).sum() / told.sum()
    assert ratio == pytest.approx(1, abs=0.1)


def test_direct_light_is_exact(tracer: Tracer, room_tracer: Tracer) -> None:
    light = picture()
    np.testing.assert_array_equal(traced(tracer, light, least=2, most=2).direct, light)
    # A lens 0.6 m above the centre: falloff and angle of incidence.
    theatre = room_tracer.theatre
    theta = theatre.dome.directions(SIZE, SIZE)
    points = theatre.dome.radius * theta
    away = points - np.array([0.0, 0.0, 0.6])
    distance = np.linalg.norm(away, axis=-1)
    gain = np.sum(away * points, -1) / distance**3
    screen = on_screen(theatre)
    found = traced(room_tracer, light, least=2, most=2).direct[0]
    ratio = found[screen] / light[0][screen] / gain[screen][:, None]
    # One constant: what projector white is measured against.
    np.testing.assert_allclose(ratio, np.broadcast_to(ratio.mean(), ratio.shape), rtol=1e-5)
    assert np.ptp(gain[screen]) > 0.2 * gain[screen].mean()


def test_it_observes_what_it_traces(tracer: Tracer) -> None:
    light, black = picture().astype(np.float32), 0.03
    settings = Settings(least=16, most=16, seed=3)
    theatre = tracer.theatre
    dome = PathTracedDome(theatre, SIZE, SIZE, settings, black=black, tracer=tracer)
    assert dome.shape == (1, SIZE, SIZE, 3)
    assert dome.tracer is tracer
    np.testing.assert_array_equal(dome.screen, on_screen(theatre))
    seen, parts = dome.observe(light), dome.trace(light)
    assert seen.dtype == np.float32
    wanted = parts.direct + parts.indirect.mean[None] + black * dome.screen[None, :, :, None]
    np.testing.assert_allclose(seen, wanted, rtol=1e-6)
    np.testing.assert_array_equal(dome.direct(light), parts.direct)
    np.testing.assert_array_equal(parts.standard_error[0], parts.indirect.standard_error)
    # Off the screen light is left alone, and none comes back from there.
    np.testing.assert_array_equal(seen[0][~dome.screen], light[0][~dome.screen])
    other = np.where(dome.screen[..., None], light, 0.9)
    np.testing.assert_array_equal(dome.trace(other).indirect.mean, parts.indirect.mean)


def test_nothing_is_met_at_infinity() -> None:
    """By rounding a ray may leave the sphere outwards; from a wide floor many miss it."""
    theatre = replace(bare(), floor=Floor(-1.5, 9.0, ALBEDO))
    for chosen, leaving, origin, direction in (
        (bare(), SCREEN, (0.36, 0.48, 0.8), (0.36, 0.48, 0.8)),
        (bare(), SCREEN, (0.36, 0.48, 0.8), (0.8, 0.36, 0.48)),
        (theatre, FLOOR, (1.6, 0.0, -0.3), (0.36, 0.48, 0.8)),
        (theatre, FLOOR, (1.6, 0.1, -0.3), (0.01, 0.01, 0.9999)),
    ):
        o, d = (tuple(np.array([value]) for value in vector) for vector in (origin, direction))
        with np.errstate(invalid="ignore", divide="ignore"):
            hit = Room(chosen).hit(o, d, np.array([leaving]), np.array([True]))
        assert hit.surface[0] == NOTHING, (origin, direction)


# How it ends.


@pytest.mark.parametrize("error", [0.1, 0.03])
def test_the_wanted_error_is_reached(tracer: Tracer, error: float) -> None:
    found = traced(tracer, error=error, least=4, seed=2).indirect
    screen = on_screen(tracer.theatre)
    rms = np.sqrt(np.mean(found.standard_error[screen] ** 2)) / found.mean[screen].mean()
    assert found.status is Status.CONVERGED
    assert rms <= error * (1 + 1e-5)
    assert found.samples < (0.03 / error) ** 2 * 4000


def test_the_most_samples_allowed_are_taken(tracer: Tracer) -> None:
    found = traced(tracer, error=1e-5, least=4, most=37).indirect
    assert (found.status, found.samples) == (Status.EXHAUSTED, 37)
    assert found.standard_error.max() > 0
    assert "Allow more" in found.status.value


def test_the_fewest_samples_wanted_are_taken(tracer: Tracer) -> None:
    found = traced(tracer, error=1e3, least=50).indirect
    assert (found.status, found.samples) == (Status.CONVERGED, 50)


def test_it_tells_what_it_did(tracer: Tracer) -> None:
    found = traced(tracer, least=8, most=8, seed=77).indirect
    assert found.seed == 77
    assert found.seconds > 0
    assert found.limit > 5
    # A bounce is a segment: one at least for each walk.
    walks = 8 * on_screen(tracer.theatre).sum()
    assert walks < found.steps < walks * found.limit
    assert traced(tracer, least=8, most=8, bounces=1).indirect.steps == walks


@pytest.mark.parametrize("lit", [False, True])
def test_progress_only_grows_and_ends_at_one(lit: bool) -> None:
    told: list[tuple[float, str]] = []
    theatre = room(lamps=(LAMP,)) if lit else bare()
    settings = Settings(error=0.02, least=8, tile=200, seed=1)
    dome = PathTracedDome(theatre, SIZE, SIZE, settings, progress=lambda *what: told.append(what))
    dome.trace(picture())
    shares = [share for share, _ in told]
    assert len(shares) > 4
    assert 0 < shares[0] < 0.5
    assert shares == sorted(shares)
    assert shares[-1] == 1
    assert all("walks a pixel" in how for _, how in told)


# Bounces.


@pytest.mark.parametrize("kind", ["bare", "room"])
def test_bounces_add_up(tracer: Tracer, room_tracer: Tracer, kind: str) -> None:
    chosen = {"bare": tracer, "room": room_tracer}[kind]
    found = traced(chosen, least=64, most=64, per_bounce=True).indirect
    plain = traced(chosen, least=64, most=64).indirect
    assert plain.bounces is None
    assert found.bounces is not None
    assert found.bounces.shape == (found.limit + 1, SIZE, SIZE, 3)
    np.testing.assert_allclose(found.bounces.sum(0), found.mean, rtol=1e-4, atol=1e-7)
    np.testing.assert_allclose(found.mean, plain.mean, rtol=1e-6)
    assert np.all(found.bounces[0] == 0)  # direct light is computed, not traced
    each = found.bounces.mean((1, 2, 3))[1:]
    assert each[0] > each[1] > each[2] > each[3] > 0


def test_each_bounce_of_a_bare_dome_is_known(tracer: Tracer) -> None:
    """The k-th is (rho A_s / 4 pi r²)^k of the mean direct light."""
    dome, light = tracer.theatre.dome, picture()
    found = traced(tracer, light, error=0.01, least=256, per_bounce=True).indirect
    share = dome.screen_areas(SIZE, SIZE) / dome.screen_area
    mean = np.einsum("ij,ijp->p", share, light[0])
    assert found.bounces is not None
    for k in (1, 2, 3):
        wanted = mean * (np.array(ALBEDO) / 2) ** k
        seen = np.einsum("ij,ijp->p", share, found.bounces[k])
        np.testing.assert_allclose(seen, wanted, rtol=0.03)


def test_bounces_can_be_counted_out(tracer: Tracer) -> None:
    found = traced(tracer, least=32, most=32, bounces=2, per_bounce=True).indirect
    assert found.limit == 2
    assert found.bounces is not None
    assert len(found.bounces) == 3
    more = traced(tracer, least=32, most=32, per_bounce=True).indirect
    assert (
        found.mean[on_screen(tracer.theatre)].mean()
        < more.mean[on_screen(tracer.theatre)].mean() * 0.99
    )


def test_a_looser_tolerance_loses_as_much(tracer: Tracer) -> None:
    tight, loose = (
        traced(tracer, least=8, most=8, tolerance=tolerance).indirect.limit
        for tolerance in (1e-8, 1e-2)
    )
    # The largest albedo's bounces fade by 0.35 each.
    assert tight - loose == pytest.approx(np.log(1e-6) / np.log(0.35), abs=1)


# Seeds and tiles.


def test_a_seed_repeats(tracer: Tracer) -> None:
    first, again, other = (
        traced(tracer, error=0.1, least=8, seed=seed).indirect for seed in (5, 5, 6)
    )
    np.testing.assert_array_equal(first.mean, again.mean)
    np.testing.assert_array_equal(first.standard_error, again.standard_error)
    assert (first.samples, first.steps) == (again.samples, again.steps)
    screen = on_screen(tracer.theatre)
    assert np.mean(first.mean[screen] != other.mean[screen]) > 0.99


@pytest.mark.parametrize("tile", [1, 100, 10**6])
def test_tiles_bound_memory_and_nothing_else(tile: int) -> None:
    """Other random numbers, the same light."""
    theatre, size = bare(), 8 if tile == 1 else SIZE
    known = ClosedFormDome(theatre.dome, size, size, albedo=ALBEDO)
    light = picture(size)
    truth = (known.observe(light) - known.direct(light))[0]
    found = traced(Tracer(theatre), light, error=0.02, least=256, tile=tile).indirect
    assert found.status is Status.CONVERGED
    assert_unbiased(found, truth, known.screen)
    assert np.all(found.mean[~known.screen] == 0)


# Launches.


def counted(machine: DrJit, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Grows by one with each launch of that machine."""
    launches, real = [], type(machine).loop

    def loop(self: DrJit, *arguments: Any) -> Any:
        launches.append(1)
        assert len(launches) < 100
        return real(self, *arguments)

    monkeypatch.setattr(type(machine), "loop", loop)
    return launches


def test_launches_do_not_change_the_light(tracer: Tracer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor do they change errors, bounces and segments: all bytes are the same."""
    settings = {"least": 997, "most": 997, "per_bounce": True, "seed": 2}
    whole = traced(tracer, **settings).indirect
    monkeypatch.setattr(tracer.machine, "launch", 1 << 16, raising=False)
    launches = counted(tracer.machine, monkeypatch)
    parts = traced(tracer, **settings).indirect
    assert len(launches) > 5
    for name in ("mean", "standard_error", "bounces", "steps", "samples"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(parts, name))


def test_an_interrupted_pass_counts_what_it_took(
    tracer: Tracer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The walks of whole launches, whatever the pass wanted: the light is not biased."""
    known = ClosedFormDome(tracer.theatre.dome, SIZE, SIZE, albedo=ALBEDO)
    truth = (known.observe(picture()) - known.direct(picture()))[0]
    monkeypatch.setattr(tracer.machine, "launch", 1 << 17, raising=False)
    real, launches = type(tracer.machine).loop, 0

    def loop(self: DrJit, *arguments: Any) -> Any:
        nonlocal launches
        launches += 1
        if launches == 3:
            signal.raise_signal(signal.SIGINT)
        return real(self, *arguments)

    monkeypatch.setattr(type(tracer.machine), "loop", loop)
    found = traced(tracer, least=10000, most=10000, seed=3).indirect
    assert (found.status, launches) == (Status.INTERRUPTED, 3)
    assert 500 < found.samples < 1500
    assert_unbiased(found, truth, known.screen)


# Lamps.


def test_lamps_are_traced_once_and_added() -> None:
    theatre = room(lamps=(LAMP,))
    dome = PathTracedDome(theatre, SIZE, SIZE, Settings(error=0.05, seed=3))
    found, again = dome.trace(picture()), dome.trace(2 * picture())
    assert found.ambient is not None
    assert again.ambient is found.ambient
    np.testing.assert_allclose(
        found.mean, found.direct + found.indirect.mean + found.ambient.mean, rtol=1e-6
    )
    wanted = np.hypot(found.indirect.standard_error, found.ambient.standard_error)
    np.testing.assert_allclose(found.standard_error[0], wanted, rtol=1e-6)
    # The green of the lamp is twice its red, but screen and floor reflect less of it.
    red, green, blue = found.ambient.mean[dome.screen].mean(0)
    assert 0.9 < green / red < 2 * ALBEDO[1] / ALBEDO[0]
    assert blue / red < 0.5 * ALBEDO[2] / ALBEDO[0] * 1.01
    # As sure as the picture's light, on the screen.
    rms = np.sqrt(np.mean(found.ambient.standard_error[dome.screen] ** 2))
    light = found.indirect.mean[dome.screen].mean()
    assert 0.01 * light < rms <= 0.05 * light * (1 + 1e-5)


# What cannot be.


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"error": np.nan}, "above 0, got nan"),
        ({"least": 1}, "at least 2"),
        ({"least": 100, "most": 10}, "at most 10, got 100"),
        ({"tolerance": 1.0}, "0..1, got 1"),
    ],
)
def test_impossible_settings_are_refused(settings: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        Settings(**settings)


@pytest.mark.parametrize("eye", [(0.0, 0.0, 5.0), (9.0, 0.0, 0.0), (np.nan, 0.0, 0.0)])
def test_an_eye_outside_is_refused(tracer: Tracer, eye: tuple[float, float, float]) -> None:
    with pytest.raises(InputError, match="inside the dome"):
        PathTracedDome(tracer.theatre, SIZE, SIZE, eye=eye, tracer=tracer)


def test_a_brighter_picture_is_traced_alike(tracer: Tracer) -> None:
    """The same seed, and a factor that float32 knows exactly: nothing but the factor changes."""
    one, four = (traced(tracer, k * picture(), least=16, most=16).indirect for k in (1, 4))
    np.testing.assert_allclose(four.mean, 4 * one.mean, rtol=1e-5)
    np.testing.assert_allclose(four.standard_error, 4 * one.standard_error, rtol=1e-4, atol=1e-6)


def test_a_black_picture_stays_black(tracer: Tracer) -> None:
    found = traced(tracer, np.zeros((1, SIZE, SIZE, 3)))
    assert found.indirect.status is Status.CONVERGED
    assert np.all(found.mean == 0)
    assert np.all(found.standard_error == 0)


def test_many_walks_take_few_launches(tracer: Tracer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the wanted error is reached early, and the first pass is a small part of all."""
    monkeypatch.setattr(tracer_module, "WALKS_A_PASS", 1 << 11)
    launches = counted(tracer.machine, monkeypatch)
    found = traced(tracer, error=1e3, least=300).indirect
    assert (found.status, found.samples) == (Status.CONVERGED, 300)
    # Of 4 walks a pixel at first, and of as many as there are then
    assert len(launches) == 8


def test_a_launch_is_as_large_as_the_machine_likes(
    tracer: Tracer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tracer.machine, "launch", 1 << 16, raising=False)
    launches = counted(tracer.machine, monkeypatch)
    found = traced(tracer, least=1500, most=1500).indirect
    pixels = on_screen(tracer.theatre).sum()
    assert found.samples == 1500
    assert len(launches) == pytest.approx(1500 * pixels / (1 << 16), abs=2)
