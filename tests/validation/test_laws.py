"""Laws: what keeps them, and for each what breaks it, and it alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from compensate import compensate
from compensate.pose import pose
from domesim.light.transfer import named
from testing.content import BALLS, DOMES
from testing.places import dome_at
from validation import laws
from validation.laws import LAWS, Shown

SIZE = 192
DOME = dome_at(0.5, 15.0)


def shown(master, light=None, **changed) -> Shown:
    """A master, and what is seen of it untouched, subtracted and of another light."""
    observation = DOME.observation(*master.shape[1:3])
    exact = pose(master, DOME).subtractive
    seen = [
        observation.observe(each) for each in (master, exact, exact if light is None else light)
    ]
    return replace(Shown(observation.direct(master), *seen, DOME), **changed)


def broken(picture: Shown) -> set[str]:
    """Names of the laws that are broken."""
    found = {law.name: law.figure(picture) for law in LAWS}
    return {law.name for law in LAWS if (found[law.name] or 0) > law.bound}


def random_master(seed: int, size: int = 96):
    """Clouds of saturated colours, points and a bright disc; some are of 8 bits."""
    random = np.random.default_rng(seed)
    clouds = gaussian_filter(random.standard_normal((size, size, 3)), (2 + 6 * seed % 7, 3, 0))
    light = 10 ** random.uniform(-3.5, -1) * np.exp(1.5 * clouds / clouds.std())
    down, right = np.mgrid[:size, :size] / size
    centre = random.uniform(0.3, 0.7, 2)
    light[np.hypot(down - centre[0], right - centre[1]) < 0.12] = random.uniform(0.3, 1, 3)
    places = random.integers(size // 4, 3 * size // 4, (12, 2))
    light[places[:, 0], places[:, 1]] = random.uniform(0.05, 1, (12, 1))
    if seed % 2:
        curve = named("srgb", white=1.0)
        light = curve.decode(np.round(255 * curve.encode(light.clip(0, 1))) / 255)
    inside = DOME.screen(size, size)[..., None]
    return (light.clip(0, 1) * inside).astype(np.float32)[None]


METHODS = {
    "nothing": lambda master: master,
    "subtraction": lambda master: pose(master, DOME).subtractive,
    "the default": lambda master: compensate(master, DOME).light,
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("seed", range(6))
def test_methods_keep_all(method, seed):
    master = random_master(seed)
    assert broken(shown(master, METHODS[method](master))) == set()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", BALLS)
def test_methods_keep_all_on_charts(method, name):
    master = DOMES[name](SIZE)
    balls = [ball[:3] for ball in BALLS[name]]
    picture = shown(master, METHODS[method](master), balls=balls)
    assert broken(picture) == set()
    assert laws.limb(picture) is not None


@pytest.fixture(scope="module")
def night():
    """Ten stars beside a disc: what is seen of subtraction."""
    return shown(DOMES["ten stars"](SIZE), balls=[BALLS["ten stars"][0][:3]])


def weigh(picture: Shown):
    """Luminance of each pixel of the master, (1, row, col, 1)."""
    return (picture.master @ DOME.projector.luminance_weights)[..., None]


def test_a_pixel_that_outshines_another_no_more_breaks_order(night):
    at, _ = laws.points(night, 0)
    rows, cols = np.nonzero(at)
    assert len(rows) == 10
    seen = night.seen.copy()
    one, other = np.argsort(night.master[0, rows, cols].sum(-1))[-3:-1]
    for first, second in ((one, other), (other, one)):
        seen[0, rows[first], cols[first]] = night.seen[0, rows[second], cols[second]]
    assert "order" in broken(replace(night, seen=seen))


def test_a_rim_that_turns_breaks_limb(night):
    x, y, radius = night.balls[0]
    down, right = (np.mgrid[:SIZE, :SIZE] + 0.5) / SIZE * 2 - 1
    away = np.hypot(right - x, down - y) / radius
    rim = np.exp(-(((away - 0.9) / 0.02) ** 2))[None, ..., None]
    assert "limb" in broken(replace(night, seen=night.seen * (1 + 0.3 * rim)))
    assert broken(replace(night, seen=night.seen * (1 + 0.004 * rim))) == set()


@pytest.mark.parametrize("times", [1.5, 4.0])
def test_points_that_gain_more_than_twice_break_bound(night, times):
    at, _ = laws.points(night, 0)
    ground = np.median((night.seen - night.master)[:, night.screen], axis=1)
    seen = night.seen.copy()
    seen[0, at] = night.master[0, at] + times * ground
    assert ("bound" in broken(replace(night, seen=seen))) == (times > 2)


@pytest.mark.parametrize(("gain", "breaks"), [(0.5, True), (0.9, False), (3.0, True)])
def test_stars_keep_their_light(night, gain, breaks):
    at, _ = laws.points(night, 0)
    base = night.subtracted if gain < 1 else night.untouched
    seen = night.seen.copy()
    seen[0, at] = gain * base[0, at]
    assert ("stars" in broken(replace(night, seen=seen))) == breaks


def test_a_place_that_is_brighter_than_untouched_is_harmed(night):
    down, right = np.mgrid[:SIZE, :SIZE]
    spot = np.exp(-((down - 60) ** 2 + (right - 90) ** 2) / 50)[None, ..., None]
    seen = np.maximum(night.seen, night.untouched * (1.3 * spot))
    assert broken(replace(night, seen=seen)) == {"harm"}


def test_a_darker_half_that_is_brighter_breaks_its_law():
    dim = shown(DOMES["ten stars"](SIZE))
    low = weigh(dim) <= np.median(weigh(dim)[:, dim.screen])
    raised = np.where(low, 1.01 * dim.untouched, dim.untouched)
    assert broken(replace(dim, seen=raised.astype(np.float32))) == {"dark"}


def test_what_is_exact_stays():
    down, right = np.mgrid[:SIZE, :SIZE]
    even = np.full((1, SIZE, SIZE, 3), 0.5, np.float32) * DOME.screen(SIZE, SIZE)[..., None]
    found = shown(even)
    assert laws.exact(found) < laws.LAWS[5].bound
    assert laws.LAWS[5].name == "exact"
    spot = 1 - 1e-3 * np.exp(-((down - 60) ** 2 + (right - 90) ** 2) / 50)[None, ..., None]
    assert "exact" in broken(replace(found, seen=found.seen * spot))
    assert laws.exact(shown(DOMES["ten stars"](SIZE))) is None


def test_contours_of_neighbouring_codes_break_steps_unless_the_product_tells(monkeypatch):
    sky = shown(DOMES["first codes"](SIZE))
    assert broken(sky) == set()
    low, lit = np.median(sky.master[:, sky.screen], axis=1), weigh(sky)
    stepped = np.where(lit > low @ DOME.projector.luminance_weights, 1.15, 1.0) * sky.seen
    assert laws.steps(replace(sky, seen=stepped)) is None
    monkeypatch.setattr(laws, "share_of_steps", lambda *_: 0.0)
    assert "steps" in broken(replace(sky, seen=stepped))
    finer = replace(sky, master=sky.master * np.float32(0.97))
    assert laws.steps(finer) is None


def test_points_stand_out_from_all_around():
    plane = np.zeros((1, SIZE, SIZE, 3), np.float32)
    plane[0, 60, 90] = 0.5
    plane[0, 100, 90:92] = 0.5  # two are no point
    at, around = laws.points(shown(plane), 0)
    assert np.argwhere(at).tolist() == [[60, 90]]
    assert around[60, 90] == laws.HARDLY
