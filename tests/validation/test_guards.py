"""Public functions by wrong inputs: nothing but InputError, and no silent NaN.

The functions are those of the modules that docs/api.md names above "Inside", so that a new one is
asked, too. `VALID` has a call of each that is right; one of its arrays at a time is made wrong.
"""

from __future__ import annotations

import inspect
import re
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from compensate.pose import pose
from compensate.solver.accelerated import Accelerated
from compensate.solver.admm import ADMM
from compensate.solver.gpcg import GPCG
from compensate.vision.castle import ACHROMATIC
from compensate.vision.saliency import gbvs
from domesim.errors import InputError
from domesim.light.guarded import guarded
from domesim.observation.linear import LinearObservation
from domesim.room.dome import Dome
from domesim.room.theatre import Lens, Theatre
from domesim.room.viewing import of_flat_screen
from domesim.scene import load_scene
from domesim.stereo.system import CircularFilter, PolarisedProjector, SilverScreen
from validation import judge
from validation.experiment import Missing

API = Path(__file__).parents[2] / "docs" / "api.md"
ARRAYS = re.compile(r"Light|Floats|Planes|NDArray|ArrayLike|Mask|\bArray\b")

CHECKED_ELSEWHERE = {
    "tests/test_wrong_inputs.py": "observe render save compensate pose predict",
    "tests of files": "encoded as_codes",
    "guards themselves": "require_light require_finite require_mask require_linear "
    "require_within_range require_pictures",
    "tools for arrays of any kind": "namespace on_host as_sent kind total dot",
    "pieces of what is guarded": "expand mixing_by lifted_light aimed_light averaged block_of "
    "around_of around_of_plane certified quality_lost pooled enlarged if_installed "
    "visible_steps share_of_steps beyond graded vector matrix",
}
"""Where functions without a line in `VALID` are checked."""

SCENE = load_scene("dome_hemisphere")
RNG = np.random.default_rng(3)
LIGHT = 0.1 + 0.5 * RNG.random((1, 32, 32, 3))
PLANES = 1 + RNG.random((1, 32, 32))
PLANE = PLANES[0]
MASK = np.ones((32, 32), bool)
WEIGHTS = SCENE.projector.luminance_weights
XYZ = np.array([[0.4, 0.3, 0.2], [0.2, 0.7, 0.1], [0.02, 0.1, 0.9]])
GLASS = CircularFilter("left")
SILVER = SilverScreen(4, 2, 0.1, 0.3), PolarisedProjector((0, -9, 1), GLASS), GLASS
FREQUENCY = np.array([1.0, 4.0])
WINS = np.array([[0, 5], [3, 0]])
COUNTS = np.array([[[0, 2], [1, 0]], [[0, 3], [0, 0]], [[0, 1], [2, 0]]])

LENS = Lens("lens", (0.0, 0.0, 0.0), (0.0, 0.0, 3.0))

VALID: dict[str, dict[str, Any]] = {
    "relative_primaries": {"xyz": XYZ},
    "mean_luminance": {"light": LIGHT, "scene": SCENE},
    "within_range": {"light": LIGHT, "screen": MASK},
    "require_black": {"black": np.zeros(3), "primaries": 3},
    "leak_matrices": {"crosstalk": 0.02 * np.eye(3)},
    "leaks_of_views": {"shares": 0.1 * np.ones((4, 4))},
    "over_pixels": {"coarse": np.ones((2, 3, 4)), "rows": 8, "cols": 9},
    "interpolation": {"places": np.linspace(-0.9, 0.9, 5), "nodes": 15},
    "sample_nodes": {"tables": np.ones((2, 15, 15)), "u": np.zeros(4), "v": np.zeros(4)},
    "seen_luminance": dict(
        zip(("screen", "projector", "glass"), SILVER, strict=True),
        eye=np.array([0.0, -7, 0]),
        points=np.array([[0.0, 0, 0], [1, 0, 0.5]]),
    ),
    "screen_gain": {"screen": SILVER[0], "incidence": np.array([0.1, 0.2])},
    "path_traced": {
        "theatre": Theatre(Dome(3.0, np.pi / 2), (0.5,) * 3, lenses=(LENS,), corrected=False),
        "light": LIGHT[0],
        "size": 4,
        "samples": 4,
        "depth": 3,
        "detail": 16,
    },
    "linear_ycbcr": {"luminance_weights": WEIGHTS},
    "own_problem": {"desired": LIGHT, "scene": SCENE},
    "regions": {"mask": MASK},
    "probability": {"masking": PLANES},
    "of_colours": {"master": LIGHT[0, 0], "seen": LIGHT[0, 1], "luminance_weights": WEIGHTS},
    "edge_energy": {"error": PLANES, "ghost": PLANES, "pixels_per_degree": 8.0},
    "ghost_left": {"error": PLANES, "ghost": PLANES, "pixels_per_degree": 8.0},
    "ghost_contour": {
        "error": PLANES,
        "ghost": PLANES,
        "where": MASK[None],
        "pixels_per_degree": 8.0,
    },
    "daly": {
        "frequency": FREQUENCY,
        "orientation": np.zeros(2),
        "adaptation": 5.0,
        "image_area": 1000.0,
        "distance": 3.0,
    },
    "castle": {
        "frequency": FREQUENCY,
        "luminance": np.ones(2),
        "mechanism": ACHROMATIC,
        "area": 1.0,
    },
    "opponent_contrast": {"difference": np.full((4, 3), 0.1), "background": np.ones((4, 3))},
    "cone_threshold": {"luminance": PLANE},
    "rod_threshold": {"luminance": PLANE},
    "threshold": {"luminance": PLANE},
    "large_threshold": {"luminance": PLANE},
    "adaptation_luminance": {"luminance": PLANES, "pixels_per_degree": 8.0, "screen": MASK},
    "transducer": {"signal": PLANE},
    "sensitivity": {"frequency": FREQUENCY, "viewing": SCENE.viewing},
    "mesa": {"frequency": FREQUENCY, "edge": 2.0},
    "dom": {"frequency": FREQUENCY, "peak": 2.0},
    "fan": {"angle": FREQUENCY, "index": 0, "orientations": 6},
    "masked_difference": {
        "reference": PLANES,
        "test": PLANES,
        "adaptation": PLANES,
        "viewing": of_flat_screen(1.0, 1.0, 30.0, 5.0),
    },
    "gbvs": {"image": LIGHT[0]},
    "visible_difference": {"wanted": LIGHT, "seen": LIGHT, "pixels_per_degree": 8.0},
    "in_thresholds": {"lost": PLANES},
    "bands": {"wanted": LIGHT, "seen": LIGHT, "pixels_per_degree": 8.0},
    "mutually_masked": {"wanted": np.ones((3, 16, 16)), "seen": np.ones((3, 16, 16))},
    "reduced": {"planes": PLANES},
    "expanded": {"planes": PLANES, "size": (64, 64)},
    "two_stage": {"left": PLANE, "right": PLANE},
    "gain_control": dict.fromkeys(("left", "right", "left_energy", "right_energy"), PLANE),
    "contrast_ratio": {"left": PLANE, "right": PLANE},
    "rivals": {"left": PLANE, "right": PLANE},
    "disparities": {"left": PLANE, "right": PLANE},
    "flip": {"reference": LIGHT, "test": LIGHT, "scene": SCENE},
    "colorvideovdp": {"reference": LIGHT, "test": LIGHT, "scene": SCENE},
    "colorvideovdp_map": {"reference": LIGHT, "test": LIGHT, "scene": SCENE},
    "luminance": {"light": LIGHT, "scene": SCENE},
    "on_display": {"light": LIGHT, "scene": SCENE},
    "analyse": {"wins": WINS, "names": "ab"},
    "holm": {"p": np.array([0.01, 0.2])},
    "audience": {"counts": COUNTS, "names": "ab"},
    "share_interval": {"wins": np.array([3, 4, 5]), "trials": np.array([6, 6, 6])},
    "sign_changes": {"differences": np.array([0.1, 0.3, -0.1])},
    "bias_p": {"found": np.ones(9), "error": np.ones(9), "truth": np.ones(9)},
    "assert_unbiased": {"found": np.ones(9), "error": np.ones(9), "truth": np.ones(9)},
    "calibration": {"z": RNG.standard_normal(50)},
    "rms_difference": {
        **dict.fromkeys(("model", "first", "second"), PLANE),
        "share": MASK / MASK.sum(),
    },
}


def public():
    """Functions of docs/api.md above "Inside" that take an array, by name."""
    text = API.read_text(encoding="utf-8").partition("## Inside")[0]
    for name in re.findall(r"^   ((?:domesim|compensate|validation|testing)[\w.]*)$", text, re.M):
        module = import_module(name)
        for each, found in vars(module).items():
            if (
                inspect.isfunction(found)
                and not each.startswith("_")
                and found.__module__ == name
                and arrays_of(found)
            ):
                yield each, found


def arrays_of(function):
    parameters = inspect.signature(function).parameters.values()
    return [each.name for each in parameters if ARRAYS.search(str(each.annotation))]


FUNCTIONS = dict(public())


def wrongs(right):
    """What an array may be by mistake."""
    array = np.asarray(right)
    holed = array.astype(float)
    holed.flat[holed.size // 2] = np.nan
    return {
        "NaN": holed,
        "infinite": np.where(np.isnan(holed), np.inf, holed),
        "half precision": array.astype(np.float16),
        "complex": array.astype(complex),
        "objects": array.astype(object),
        "bool": array.astype(float) > 0.5,
        "integers": array.astype(int),
        "negative": -array.astype(float),
        "one axis more": array[None],
        "one axis less": array[0] if array.ndim else array,
        "cut": array[..., 1:] if array.ndim else array,
        "empty": array[:0] if array.ndim else array,
        "list": array.tolist(),
        "text": "light",
        "nothing": None,
        "mapping": {},
    }


def test_every_public_function_is_asked():
    elsewhere = {name for names in CHECKED_ELSEWHERE.values() for name in names.split()}
    assert set(FUNCTIONS) == VALID.keys() | elsewhere
    assert not VALID.keys() & elsewhere


@pytest.mark.parametrize("name", VALID)
def test_wrong_arrays_are_refused(name):
    function, right = FUNCTIONS[name], VALID[name]
    try:
        assert not has_nan(function(**right))
    except Missing:
        pytest.skip("needs a metric that is not installed")
    refused = []
    for parameter in arrays_of(function):
        for what, wrong in wrongs(right.get(parameter, np.ones(3))).items():
            try:
                result = function(**right | {parameter: wrong})
            except InputError as error:
                refused.append((parameter, what, str(error)))
            except AssertionError:
                assert name == "assert_unbiased"
            else:
                assert not has_nan(result), f"{parameter}: {what}"
        assert {"text", "complex"} <= {what for each, what, _ in refused if each == parameter}
    assert not any("\n" in words for _, _, words in refused)


def has_nan(result):
    if isinstance(result, tuple | list):
        return any(map(has_nan, result))
    if hasattr(result, "__dataclass_fields__"):
        return has_nan(list(vars(result).values()))
    real = isinstance(result, float | np.ndarray) and np.asarray(result).dtype.kind == "f"
    return real and bool(np.isnan(result).any())


MATRIX = np.eye(432) + 1e-3


@pytest.mark.parametrize("solver", [GPCG(), ADMM(), Accelerated()])
@pytest.mark.parametrize("what", wrongs(LIGHT))
def test_solvers_refuse_wrong_starts(solver, what):
    posed = pose(LIGHT, SCENE)
    if what == "negative":  # the bounds make light of it
        return
    with pytest.raises(InputError):
        solver(posed.problem, wrongs(LIGHT)[what])


@pytest.mark.parametrize("what", ["NaN", "complex", "objects", "cut", "text", "nothing", "mapping"])
def test_own_maps_are_refused(what):
    with pytest.raises(InputError):
        LinearObservation.of_matrix((1, 12, 12, 3), wrongs(MATRIX)[what])
    with pytest.raises(InputError):
        LinearObservation.of_matrix((1, 12, 12, 3), MATRIX, wrongs(LIGHT[:, :12, :12])[what])


def test_a_guard_tells_who_wanted_what():
    with pytest.raises(InputError, match=r"^gbvs's image takes real numbers, got 'light'$"):
        gbvs("light")

    @guarded
    def share(first: np.ndarray, second: float) -> float:
        return float(first[0] / second)

    with pytest.raises(InputError, match=r"^share's first takes a ndarray, got 'a'"):
        share("a", 2)
    with pytest.raises(InputError, match=r"^share's second takes a number, got '2'"):
        share(np.ones(2), "2")
    with pytest.raises(InputError, match=r"has no number for first = float64 .2,. with 1 not"):
        share(np.array([np.nan, 1]), 2.0)
    assert share(np.ones(2), 2) == 0.5


@pytest.mark.parametrize("fault", [TypeError, AttributeError, IndexError, ValueError, KeyError])
def test_a_fault_of_ours_is_not_told_as_the_users(fault, monkeypatch):
    """Of right arguments and of wrong ones: what is raised deep within comes out as it is."""

    def broken(*_, **__):
        raise fault("ours")

    monkeypatch.setattr("compensate.vision.saliency._activation", broken)
    with pytest.raises(fault, match="ours") as found:
        gbvs(LIGHT[0])
    assert not isinstance(found.value, InputError)
    with pytest.raises(InputError, match="takes real numbers"):
        gbvs("light")


def test_axes_go_together():
    @guarded(light="... row col 3", weights="3", like="*s", other="*s 2")
    def function(
        light: ArrayLike,
        weights: ArrayLike = (1, 1, 1),
        like: ArrayLike | None = None,
        other: ArrayLike = (0, 0),
    ) -> float:
        return 1.0

    for right in (
        {"light": np.ones((4, 5, 3))},
        {"light": np.ones((2, 1, 4, 5, 3)), "like": None},
        {"light": np.ones((4, 5, 3)), "like": 2.0, "other": np.ones((7, 2))},
        {"light": np.ones((4, 5, 3)), "like": np.ones((6, 1)), "other": np.ones((7, 2))},
    ):
        assert function(**right) == 1
    for wrong in (
        {"light": np.ones((4, 5, 4))},
        {"light": np.ones((5, 3))},
        {"light": np.ones((4, 0, 3))},
        {"light": np.ones((4, 5, 3)), "weights": [1, 1]},
        {"light": np.ones((4, 5, 3)), "weights": 1.0},
        {"light": np.ones((4, 5, 3)), "like": np.ones(6), "other": np.ones((7, 2))},
    ):
        with pytest.raises(InputError, match=r"^function's \w+ takes the axes"):
            function(**wrong)


def test_the_panel_is_asked_at_the_top():
    said = judge(LIGHT, 0.9 * LIGHT, "dome_hemisphere", by=["Delta E ITP", "PU21-PSNR"])
    assert list(said) == ["Delta E ITP", "PU21-PSNR"]
    assert all(value > 0 for value in said.values())
    with pytest.raises(InputError, match="no judge is called Moon"):
        judge(LIGHT, LIGHT, SCENE, by=["Moon"])
    for what, wrong in wrongs(LIGHT).items():
        if what != "negative":
            for pictures in ((LIGHT, wrong), (wrong, LIGHT)):
                with pytest.raises(InputError):
                    judge(*pictures, SCENE, by=["Delta E ITP"])
