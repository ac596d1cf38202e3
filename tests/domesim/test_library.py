"""Light in and light out, from the tops of the packages."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import compensate
import domesim
from domesim import load_master, load_scene, observe, save
from domesim.errors import InputError
from domesim.frames import ColourTag, Frame, write_frame

DOME = load_scene("dome_imax")


def picture(views: int, rows: int, cols: int) -> np.ndarray:
    return np.random.default_rng(4).random((views, rows, cols, 3)).astype(np.float32)


def stored(path: Path) -> Path:
    """A PNG of 16 bits in P3."""
    tag = ColourTag("srgb", "P3-D65", "file")
    write_frame(Frame(picture(1, 24, 24)[0] / 2, path, tag, 16, floating=False), path)
    return path


def test_a_master_comes_back_as_it_was(tmp_path):
    light, master = load_master(stored(tmp_path / "a.png"), DOME)
    assert light.shape == (1, 24, 24, 3)
    assert master.colour.primaries == "P3-D65"
    assert save(light, tmp_path / "b.png", DOME, master) == 0
    again, copy = load_master(tmp_path / "b.png", DOME)
    assert np.array_equal(again, light)
    assert copy.described() == master.described()


def test_an_encoding_is_believed_over_the_file(tmp_path):
    light, _ = load_master(stored(tmp_path / "a.png"), DOME)
    other, master = load_master(tmp_path / "a.png", DOME, "gamma2.6")
    assert master.colour.source == "encoding gamma2.6"
    assert other.mean() < 0.9 * light.mean()
    with pytest.raises(InputError, match="encoding 'vlog' is not known"):
        load_master(tmp_path / "a.png", DOME, "vlog")


@pytest.mark.parametrize(
    ("name", "shape"), [("dome_imax", (1, 24, 24)), ("stereo_cinema_silver", (2, 20, 36))]
)
def test_light_of_no_file_is_stored_linearly(name, shape, tmp_path):
    scene, light = load_scene(name), picture(*shape)
    paths = [tmp_path / f"{view}.exr" for view in range(shape[0])]
    seen = observe(light, scene)
    assert save(seen, paths, scene) == 0
    again, master = load_master(paths, scene)
    assert master.colour.means_the_same_as(ColourTag("linear", scene.projector.primaries, ""))
    # EXR's chromaticities have three digits
    assert again == pytest.approx(seen, abs=1e-3)


def test_the_wrong_shape_is_refused(tmp_path):
    with pytest.raises(ValueError, match="observe takes axes"):
        observe(picture(1, 8, 8)[0], DOME)
    _, master = load_master(stored(tmp_path / "master.png"), DOME)
    with pytest.raises(ValueError, match=r"save takes light of its master's size, \(24, 24\), got"):
        save(picture(1, 12, 12), tmp_path / "a.png", DOME, master)
    with pytest.raises(ValueError, match="save takes axes"):
        save(picture(1, 8, 8)[0], tmp_path / "a.exr", DOME)


def test_a_name_that_is_not_there():
    for package in (domesim, compensate):
        with pytest.raises(AttributeError, match="has no attribute 'load_scenes'"):
            package.load_scenes  # noqa: B018
