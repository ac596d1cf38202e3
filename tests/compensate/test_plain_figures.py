"""Plain figures of made-up pictures whose figures are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from compensate import ruler
from compensate.plain import POINT, PlainFigures, PlainRuler, of_colours
from compensate.ruler import NO_DIFFERENCE, compared
from compensate.vision.castle import ACHROMATIC, castle
from domesim.inspection.magnitudes import faintest_star
from domesim.light import Light
from domesim.scene import Scene, load_scene
from testing.content import charts
from testing.judged import stars

DOME, PAIR = load_scene("dome_imax"), load_scene("stereo_cinema_silver")
SKY = ("sky", "faintest_star", "faintest_star_schaefer")
PROJECTED = ("projected_star", "projected_star_schaefer")
SIZE = 360  # two pixels a degree of the dome


def night(scene: Scene = DOME, shape: tuple[int, ...] = (1, SIZE, SIZE)) -> Light:
    """Coloured clouds of all sizes, and the lit third of them."""
    random = np.random.default_rng(7)
    grain = random.uniform(0.2, 1, (*shape, 1))
    rows, cols = np.mgrid[: shape[1], : shape[2]]
    clouds = 1 + 0.6 * np.sin(cols / 11) * np.sin(rows / 9)
    light = 0.004 * clouds[None, ..., None] * grain * np.array([0.5, 0.7, 1.0])
    light[:, :, : shape[2] // 8] = 0.5
    return light.astype(np.float32)


def figures(
    wanted: Light, seen: Light, scene: Scene, untouched: float | None = None
) -> PlainFigures:
    own = PlainRuler(wanted, scene, scene.screen(*wanted.shape[1:3]))
    return own.figures(seen, own.black(seen) if untouched is None else untouched)


@pytest.mark.parametrize("scene", [DOME, PAIR])
def test_the_master_keeps_all(scene: Scene) -> None:
    light = night(scene, (scene.views, SIZE, SIZE))
    light[:, 100::40, 100::40] = 0.3
    found = figures(light, light, scene)
    sky = {name: getattr(found, name) for name in SKY}
    assert (None in sky.values()) == (scene is PAIR)
    assert vars(found) == pytest.approx(
        {
            **sky,
            **dict.fromkeys(PROJECTED),
            "black": 1,
            "contrast_fine": 1,
            "contrast_coarse": 1,
            "stars": 1,
            "stars_in_order": None,
            "hue_shift": 0,
        },
        abs=1e-6,
    )


@pytest.mark.parametrize("veil", [0.001, 0.004, 0.02])
def test_a_veil_takes_contrast_and_raises_black(veil: float) -> None:
    level, white = 0.004, DOME.projector.white
    rows, cols = np.mgrid[:SIZE, :SIZE]
    waves = level * (1 + 0.1 * np.sin(cols / 1.5) + 0.1 * np.sin(rows / 5))
    waves[:, : SIZE // 5] = 0.5
    light = np.repeat(waves[None, ..., None], 3, axis=-1).astype(np.float32)
    own = PlainRuler(light, DOME, DOME.screen(SIZE, SIZE))
    found = own.figures((light + veil).astype(np.float32), own.black(light))
    assert found.black == pytest.approx(1 + veil * white / own.black(light), rel=1e-5)
    assert found.contrast_coarse == pytest.approx(level / (level + veil), rel=0.02)


@pytest.mark.parametrize("veil", [0.0, 0.001, 0.004, 0.02, 0.2])
def test_texture_counts_as_far_as_it_is_above_threshold(veil: float) -> None:
    """A checkerboard of half a degree, by castleCSF at 1 cycle/degree; under 0.2 it is not seen."""
    level, contrast, white = 0.004, 0.4, DOME.projector.white
    board = level * (1 + contrast * (-1.0) ** np.add.outer(np.arange(SIZE), np.arange(SIZE)))
    board[:, : SIZE // 5] = 0.5
    light = np.repeat(board[None, ..., None], 3, axis=-1).astype(np.float32)
    own = PlainRuler(light, DOME, DOME.screen(SIZE, SIZE))
    found = own.figures((light + np.float32(veil)).astype(np.float32), own.black(light))

    def above(luminance: float, shown: float) -> float:
        threshold = 1 / float(castle(1.0, white * luminance, ACHROMATIC, area=1.0))
        return max(shown - threshold, 0.0)

    expected = above(level + veil, contrast * level / (level + veil)) / above(level, contrast)
    assert found.contrast_fine == pytest.approx(expected, rel=2e-3)
    assert (expected == 0) == (veil == 0.2)


def test_contrast_is_of_ratios_not_of_differences() -> None:
    """Twice the light has the contrast that it had; reversed light has less than none."""
    light = night()
    twice = figures(light, (2 * light).astype(np.float32), DOME)
    assert twice.contrast_coarse == pytest.approx(1, abs=1e-3)
    turned = np.where(light < 0.1, 0.012 - light, light).astype(np.float32)
    assert figures(light, turned, DOME).contrast_coarse < 0


def test_fine_contrast_is_of_fine_things() -> None:
    """Of a picture that is smooth within a degree only the coarse is left."""
    light = night(PAIR, (2, 270, 480))
    light[:, 60:200, 200:330] *= 2
    sigma = 1.0 * PAIR.viewing.pixels_per_degree(270, 480)
    found = figures(light, gaussian_filter(light, (0, sigma, sigma, 0)), PAIR)
    assert found.contrast_fine is not None
    assert abs(found.contrast_fine) < 0.15
    assert found.contrast_coarse is not None
    assert found.contrast_coarse > 0.5


def test_flat_light_has_no_contrast_no_stars_and_grey_no_hue() -> None:
    grey = np.full((1, SIZE, SIZE, 3), 0.1, np.float32)
    found = figures(grey, grey + np.float32(0.01), DOME, untouched=0.0)
    assert replace(found, **dict.fromkeys(SKY)) == PlainFigures()


def test_light_off_the_screen_does_not_count() -> None:
    light = night()
    on = DOME.screen(SIZE, SIZE)[..., None]
    other = np.where(on, light, np.float32(0.9))
    assert figures(light, other, DOME) == figures(light, light, DOME)


def test_stars_have_light_and_order() -> None:
    light = stars()
    assert figures(light, light, DOME).stars_in_order == 1
    veiled = figures(light, light + np.float32(0.01), DOME)
    assert (veiled.stars, veiled.stars_in_order) == pytest.approx((1, 1), abs=1e-5)
    assert figures(light, 0.4 * light, DOME).stars == pytest.approx(0.4, rel=1e-4)
    # What is above a level is one
    levelled = figures(light, np.minimum(light, np.float32(0.1)), DOME)
    bright = np.geomspace(0.01, 1, 10)
    shown = np.minimum(bright, 0.1)
    pairs = [(i, j) for i in range(10) for j in range(i)]
    kept = [shown[i] > 1.02 * shown[j] for i, j in pairs]
    assert levelled.stars_in_order == pytest.approx(np.mean(kept), abs=1e-6)
    assert levelled.stars_in_order < 0.9


@pytest.mark.parametrize(("ratio", "is_star"), [(1.1 * POINT, True), (0.9 * POINT, False)])
def test_a_star_stands_out_from_all_around(ratio: float, is_star: bool) -> None:
    light = np.full((1, SIZE, SIZE, 3), 0.01, np.float32)
    light[0, 101, 203] = 0.01 * ratio
    assert (figures(light, light, DOME).stars is not None) == is_star
    light[0, 101:103, 203:205] = 0.01 * ratio
    assert (figures(light, light, DOME).stars is not None) == is_star
    # The rim of what is larger is no star
    light[0, 97:106, 199:208] = 0.01 * ratio
    assert figures(light, light, DOME).stars is None


def test_hue_turns_and_fades() -> None:
    red, turned = np.array([[0.02, 0.01, 0.01]]), np.array([[0.01, 0.01, 0.02]])
    weights = np.array([0.2, 0.7, 0.1])
    assert of_colours(red, 3 * red, weights).hue_shift == pytest.approx(0, abs=1e-6)
    faded = of_colours(red, red + 0.01, weights)
    assert faded.hue_shift == pytest.approx(0, abs=1e-6)
    brightness = float(red[0] @ weights)
    assert faded.saturation == pytest.approx(brightness / (brightness + 0.01))
    assert of_colours(red, turned, weights).hue_shift > 60
    assert of_colours(turned, red, weights).hue_shift == pytest.approx(
        of_colours(red, turned, weights).hue_shift
    )


def test_large_pictures_are_averaged_but_for_stars(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ruler, "FINEST", SIZE // 2)
    light = night().repeat(2, 1).repeat(2, 2)[:, 180:540, 180:540]
    light[0, 201, 101] = 0.3
    seen = (0.7 * light + 0.004).astype(np.float32)
    screen = np.ones((360, 360), bool)
    found = PlainRuler(light, PAIR, screen).figures(seen, 1.0)
    small = [each.reshape(1, 180, 2, 180, 2, 3).mean((2, 4)) for each in (light, seen)]
    half = PlainRuler(small[0], PAIR, screen[::2, ::2]).figures(small[1], 1.0)
    assert found.stars == pytest.approx(0.7, rel=1e-4)
    assert found.black == pytest.approx(half.black, rel=1e-5)
    assert found.contrast_coarse == pytest.approx(half.contrast_coarse, rel=1e-4)


def test_small_differences_are_none() -> None:
    assert compared(0.3, 0.3 + 0.9 * NO_DIFFERENCE) == "no different from"
    assert compared(0.3, 0.3 + 1.1 * NO_DIFFERENCE) == "better than"
    assert compared(0.3, 0.3 - 1.1 * NO_DIFFERENCE) == "worse than"


@pytest.mark.parametrize("chart", ["ten stars", "magnitudes"])
def test_a_veil_takes_the_faint_stars(chart: str) -> None:
    """Of the master, and the more light lies over it, the fewer."""
    light = charts.CHARTS[chart](SIZE)
    own = PlainRuler(light, DOME, DOME.screen(SIZE, SIZE))
    veils = [0, *np.geomspace(1e-6, 0.3, 30)]
    seen = [own.figures((light + veil).astype(np.float32), 1.0) for veil in veils]
    for name in SKY:
        values = [getattr(each, name) for each in seen]
        values = [value for value in values if value is not None]  # a black sky has no brightness
        assert len(values) >= len(veils) - 1
        assert np.diff(values).max() <= 1e-4  # the light of stars, in float32
        assert values[0] > values[-1] + 2
    assert vars(own.of_master(1.0)) == vars(seen[0])


def test_the_faintest_star_by_hand() -> None:
    """Stars of a pixel, half a degree wide, on an even sky: dimmed by half, they lose 0.75."""
    level, side = 0.004, 1 / 2
    light = np.full((1, SIZE, SIZE, 3), level, np.float32)
    light[:, 100:260:20, 100:260:20] = 0.1
    found = figures(light, light, DOME)
    sky, area = level * DOME.projector.white, np.radians(side) ** 2
    assert found.sky == pytest.approx(12.58 - 2.5 * np.log10(sky), abs=1e-4)
    expected = faintest_star(sky, area)
    assert found.faintest_star == pytest.approx(expected.crumey, abs=1e-4)
    assert found.faintest_star_schaefer == pytest.approx(expected.schaefer, abs=1e-4)
    dimmed = figures(light, np.where(light > level, (light + level) / 2, light), DOME)
    assert dimmed.faintest_star == pytest.approx(found.faintest_star - 2.5 * np.log10(2), abs=1e-4)
    spread = light.copy()
    spread[:, 100:260:20, 101:261:20] = 0.1
    spread[:, 100:260:20, 100:260:20] += 0.001  # a peak
    assert figures(spread, spread, DOME).faintest_star == pytest.approx(
        faintest_star(sky, 2 * area).crumey, abs=0.02
    )


def test_stars_without_light_are_not_seen() -> None:
    light = np.full((1, SIZE, SIZE, 3), 0.004, np.float32)
    light[:, 100:260:20, 100:260:20] = 0.1
    found = figures(light, np.full_like(light, 0.004), DOME)
    assert found.sky is not None
    assert found.faintest_star is None
