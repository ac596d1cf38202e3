"""A prediction of a fine master is one of the master averaged to what it tells apart."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest

from compensate.pose import Stage
from compensate.prediction import Combination, Prediction, reduction, regions, triage
from compensate.shows.predicting import _figures, _png
from domesim.frames import read_master
from domesim.light import Light
from domesim.light.blocks import light_means
from domesim.scene import Scene, load_scene
from domesim.scene.screening import averaged_on_screen, decoded, within_range
from testing.content.street import night_street
from testing.masters import night, write_exr

DOME, PAIR = load_scene("dome_imax"), load_scene("stereo_polarised_paper")


def test_a_master_is_reduced_as_far_as_its_sides_and_the_settings_allow() -> None:
    fine, by_contrast = Prediction(), Prediction(combination=Combination.LOCAL_CONTRAST)
    # 22.8 pixels per degree; blocks must fill the picture
    assert reduction(DOME, fine, 4096, 4096) == 4
    assert reduction(DOME, fine, 4094, 4094) == 2
    assert reduction(DOME, fine, 4095, 4095) == 1
    assert reduction(DOME, fine, 1024, 1024) == 1
    assert reduction(DOME, by_contrast, 4096, 4096) == 1
    assert reduction(DOME, by_contrast, 8192, 8192) == 2
    # 40.2 pixels per degree, and the other eye has a ghost
    assert reduction(PAIR, fine, 1080, 1920) == 4


def test_light_is_averaged_without_all_of_it(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    write_exr(path, 3 * night(60)[0])
    master, screen = read_master([path]), DOME.screen(60, 60)
    light, beyond = within_range(decoded(master, DOME), screen)
    assert beyond > 0
    expected = light_means(light, 3, screen)
    np.testing.assert_allclose(averaged_on_screen(master, DOME, 3), expected, atol=1e-6)


def test_regions_are_told_in_pixels_of_the_master() -> None:
    posed = Stage(DOME).pose(night(256))
    found = triage(posed)
    boxes = regions(found.subtracted.mask, round(DOME.viewing.pixels_per_degree(256, 256)))
    assert boxes
    edges = [[edge for side in box for edge in (side.start, side.stop)] for box in boxes]
    assert _figures(posed, found, 1)["regions"] == edges
    assert _figures(posed, found, 4)["regions"] == (4 * np.array(edges)).tolist()


def test_pictures_of_maps_are_no_longer_than_they_are_looked_at(tmp_path: Path) -> None:
    path, plane = tmp_path / "a.png", np.zeros((40, 2112), np.float32)
    path.write_bytes(_png(path, plane, plane, "black"))
    spec = oiio.ImageBuf(str(path)).spec()
    assert (spec.width, spec.height) == (2 * 704 + 4, 14)


@pytest.mark.parametrize(
    "dim", [0.003, *(pytest.param(dim, marks=pytest.mark.long) for dim in (1.0, 0.3))]
)
@pytest.mark.parametrize(
    ("scene", "master"),
    [
        pytest.param(PAIR, lambda: night_street(960)[:, :540], id="pair"),
        pytest.param(DOME, lambda: night(2048), id="dome", marks=pytest.mark.long),
    ],
)
def test_a_reduced_master_has_the_verdict_of_the_whole_one(
    scene: Scene, master: Callable[[], Light], dim: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    light = (dim * master()).astype(np.float32)
    step = reduction(scene, Prediction(), *light.shape[1:3])
    assert step > 1
    small = triage(Stage(scene).pose(light_means(light, step, scene.screen(*light.shape[1:3]))))
    for name in ("FINEST", "FINEST_OF_ONE_VIEW"):
        monkeypatch.setattr(f"compensate.prediction.{name}", 100.0)
    whole = triage(Stage(scene).pose(light))
    assert small.verdict is whole.verdict
    assert small.untouched.share == pytest.approx(whole.untouched.share, abs=0.01)
    assert small.subtracted.share == pytest.approx(whole.subtracted.share, abs=0.01)
