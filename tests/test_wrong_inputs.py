"""Each public function refuses what it cannot use: by InputError, and never by a silent NaN."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import array_api_strict
import numpy as np
import pytest

import compensate as top
from compensate import compensate
from compensate.pose import pose
from compensate.prediction import Combination, Prediction, predict
from compensate.ruler import Ruler
from domesim import load_master, load_scene, observe, render, save, tabulate
from domesim.errors import InputError
from domesim.light import Light
from domesim.observation.transport import load_transport
from domesim.scene.loading import scene_content

SCENE = "dome_planetarium"
LIGHT = np.full((1, 32, 32, 3), 0.05, np.float32)
LIGHT[:, 10:14, 10:14] = 0.8
HOLED = LIGHT.copy()
HOLED[0, 16, 16, 0] = np.nan

WRONG: dict[str, Any] = {
    "integers": (LIGHT * 255).astype(int),
    "half precision": LIGHT.astype(np.float16),
    "complex": LIGHT.astype(complex),
    "one view without its axis": LIGHT[0],
    "a list": LIGHT.tolist(),
    "nothing": None,
    "a pair": np.concatenate([LIGHT, LIGHT]),
    "four primaries": np.concatenate([LIGHT, LIGHT[..., :1]], axis=-1),
    "no square": LIGHT[:, :20],
    "no pixels": LIGHT[:, :0, :0],
    "NaN": HOLED,
    "infinite": np.where(np.isnan(HOLED), np.inf, HOLED),
}
"""Light that a dome has not."""

FUNCTIONS: dict[str, Callable[[Light], object]] = {
    "compensate": lambda light: compensate(light, SCENE),
    "compensate by subtraction": lambda light: compensate(light, SCENE, method="subtractive"),
    "observe": lambda light: observe(light, SCENE),
    "pose": lambda light: pose(light, load_scene(SCENE)),
    "render": lambda light: render(light, SCENE),
    "predict at the top": lambda light: top.predict(light, SCENE),
    "predict of light": lambda light: (
        top.predict(LIGHT, SCENE, projected=light)
        if light is not None
        else top.predict(light, SCENE)
    ),
    "save": lambda light: save(light, Path("never.exr"), SCENE),
    "predict": lambda light: predict(pose(light, load_scene(SCENE))),
    "Ruler": lambda light: Ruler(light, load_scene(SCENE), np.ones((32, 32), bool)).lost(light),
}


@pytest.mark.parametrize(
    ("function", "wrong"),
    [
        (function, wrong)
        for function in FUNCTIONS
        for wrong in WRONG
        if function != "Ruler" or wrong not in ("a pair", "no square")  # it takes any views
    ],
)
def test_wrong_light_is_refused(function, wrong, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError):
        FUNCTIONS[function](WRONG[wrong])
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("scene", ["no_such_dome", Path("none.toml"), None, 3, LIGHT])
@pytest.mark.parametrize(
    "function",
    [
        lambda scene: compensate(LIGHT, scene),
        lambda scene: observe(LIGHT, scene),
        lambda scene: save(LIGHT, "never.exr", scene),
        lambda scene: load_master("none.exr", scene),
        load_scene,
    ],
)
def test_what_is_no_scene_is_refused(function, scene):
    with pytest.raises(InputError):
        function(scene)


@pytest.mark.parametrize(
    "call",
    [
        lambda: compensate(LIGHT, SCENE, method="magic"),
        lambda: compensate(LIGHT, SCENE, weighting="magic"),
        lambda: compensate(LIGHT, SCENE, method="raised-black-local"),
        lambda: load_master(3, SCENE),
        lambda: predict(pose(LIGHT, load_scene(SCENE)), Prediction()),
        lambda: top.predict(LIGHT, SCENE, combination="magic"),
        lambda: top.predict(LIGHT, SCENE, threshold=2.0),
        lambda: tabulate("stereo_shutter"),
        lambda: tabulate(SCENE, error=-1.0),
        lambda: render(LIGHT, SCENE, error=0.0),
        lambda: render(LIGHT, "stereo_shutter"),
        lambda: load_master("none.exr", SCENE),
        lambda: load_transport("none.npz"),
        lambda: load_transport(Path(__file__)),
        lambda: Ruler(LIGHT, load_scene(SCENE), np.ones((8, 8), bool)),
        lambda: Ruler(LIGHT, load_scene(SCENE), np.zeros((32, 32), bool)),
    ],
)
def test_other_wrong_arguments_are_refused(call):
    with pytest.raises(InputError):
        call()


def test_scenes_in_memory():
    """A sweep needs no files: a whiter screen adds more light, as the closed form says."""
    content = scene_content("dome_hemisphere")
    patch = np.zeros_like(LIGHT)
    patch[:, 14:18, 14:18] = 1.0
    for albedo in (0.3, 0.6):
        content["screen"]["albedo"] = albedo
        black = observe(patch, content)[0, 2, 16, 0]
        lit = observe(patch, content)[0, 16, 16, 0] - black
        assert lit == pytest.approx(1.0, abs=1e-6)
        white = observe(np.ones_like(LIGHT), content)[0, 16, 16, 0]
        assert white - 1 == pytest.approx(albedo / 2 / (1 - albedo / 2), rel=1e-3)
    assert load_scene(content).name == "dome_hemisphere"
    del content["screen"]["albedo"]
    with pytest.raises(InputError, match=r"scene 'dome_hemisphere'.*albedo"):
        load_scene(content)


def test_scenes_are_values():
    """They are compared, kept as keys and sent to other processes; a change makes another."""
    for name in ("dome_planetarium", "stereo_room", "cinema_2d", "dome_stereo_polarised"):
        scene = load_scene(name)
        same = pickle.loads(pickle.dumps(load_scene(scene_content(name))))
        assert same == scene
        assert {scene: 1}[same] == 1
        assert load_scene(name, projector={"white_cd_m2": 17.0}) != scene
    sweep = [load_scene("dome_hemisphere", screen={"albedo": rho}) for rho in (0.2, 0.4)]
    assert [each.albedo[1] for each in sweep] == [0.2, 0.4]
    with pytest.raises(InputError, match=r"screen\.albedo"):
        load_scene("dome_hemisphere", screen={"albedo": None})


def test_light_comes_back_in_its_own_library():
    there = array_api_strict.asarray(LIGHT)
    for function in (FUNCTIONS["observe"], lambda light: compensate(light, SCENE).light):
        found, expected = function(there), function(LIGHT)
        assert isinstance(found, type(there))
        assert found.dtype == there.dtype
        np.testing.assert_allclose(np.asarray(found), expected, atol=1e-6)


def test_a_scene_may_be_named_and_a_weighting_too():
    named = compensate(LIGHT, SCENE, weighting="aim").light
    np.testing.assert_array_equal(named, compensate(LIGHT, load_scene(SCENE)).light)
    np.testing.assert_array_equal(compensate(LIGHT, SCENE, method="none").light, LIGHT)


def test_one_signature_for_all():
    """Names or objects, settings by name; each gives what the modules' own function gives."""
    scene = load_scene("dome_hemisphere")
    paper = Prediction(combination=Combination.PAPER)
    by_name = top.predict(LIGHT, "dome_hemisphere", combination="paper")
    np.testing.assert_array_equal(
        by_name.prediction, predict(pose(LIGHT, scene), settings=paper).prediction
    )
    seen, traced = (each(LIGHT, scene) for each in (observe, partial(render, error=0.02)))
    np.testing.assert_allclose(
        np.mean(traced[0, 4:28, 4:28]), np.mean(seen[0, 4:28, 4:28]), rtol=0.01
    )
    stored = scene.with_transport(tabulate(scene, error=0.01))
    np.testing.assert_allclose(observe(LIGHT, stored), seen, atol=0.01)
