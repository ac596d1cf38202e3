"""The panel against published figures, ranks that all judges share, and what they may not see."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from domesim.scene import load_scene
from testing.masters import night
from validation import judges, panel
from validation.experiment import Missing

DOME = load_scene("dome_hemisphere")
PAIR = load_scene("stereo_cinema_silver")
LED = load_scene("dome_led")
SHAPE = (168, 200)

NAMES = [judge.name for judge in panel.PANEL]


def chosen(name):
    return next(judge for judge in panel.PANEL if judge.name == name)


@pytest.fixture(params=NAMES)
def judge(request):
    """A judge of the panel that is installed."""
    one = chosen(request.param)
    try:
        one.judge(pair(), pair(), PAIR)
    except Missing as reason:
        pytest.skip(str(reason))
    return one


def pair():
    """(2, 168, 200, 3) two different nights."""
    rows, cols = SHAPE
    return np.concatenate([night(cols, seed=seed)[:, :rows] for seed in (1, 2)])


def even(*greys, size=24):
    return np.stack([np.full((size, size + 8, 3), grey, np.float32) for grey in greys])


def badness(one, test, reference=None, scene=PAIR):
    reference = pair() if reference is None else reference
    figure = one.judge(reference, test, scene)
    return -figure if one.higher_is_better else figure


def test_the_same_is_best_and_more_blur_is_worse(judge):
    blurred = [gaussian_filter(pair(), (0, sigma, sigma, 0)) for sigma in (0, 0.7, 3)]
    found = [badness(judge, light) for light in blurred]
    assert found[0] < found[1] < found[2]


def test_darker_is_worse_for_all_but_colorvideovdp(judge):
    """ColorVideoVDP divides each picture by its own surround, so dimming alone is free."""
    found = [badness(judge, pair() * np.float32(share)) for share in (1, 0.9, 0.3)]
    if judge.name == "ColorVideoVDP":
        assert found == pytest.approx([-10] * 3, abs=0.1)
    else:
        assert found[0] < found[1] < found[2]


def test_a_veil_is_worse_for_all_but_fovvideovdp(judge):
    """FovVideoVDP divides both pictures by the reference's surround: an even veil is free."""
    found = [badness(judge, pair() + np.float32(veil)) for veil in (0, 0.01, 0.05)]
    if judge.name == "FovVideoVDP":
        assert found == pytest.approx([-10] * 3, abs=0.01)
    else:
        assert found[0] < found[1] < found[2]


def test_the_figure_of_a_pair_is_the_mean_of_its_eyes(judge):
    test = np.stack([gaussian_filter(eye, (k, k, 0)) for k, eye in enumerate(pair(), 1)])
    eyes = [judge.judge(pair()[eye], test[eye], PAIR) for eye in (slice(0, 1), slice(1, 2))]
    assert eyes[0] != pytest.approx(eyes[1], rel=1e-3)
    assert judge.judge(pair(), test, PAIR) == pytest.approx(np.mean(eyes), rel=1e-6)


def test_outside_the_circle_nobody_looks(judge):
    master = night(168)
    test = np.where(DOME.screen(168, 168)[..., None], master, 1 - master)
    assert not np.array_equal(test, master)
    assert judge.judge(master, test, DOME) == judge.judge(master, master, DOME)


def test_too_small_a_picture_is_refused_with_the_way_out():
    pytest.importorskip("piq")
    with pytest.raises(ValueError, match="at least 161 pixels a side, got 160 x 168"):
        chosen("PU21-MS-SSIM").judge(even(0.1, 0.2, size=160), even(0.1, 0.2, size=160), PAIR)


def test_pu21_is_that_of_its_authors():
    pytest.importorskip("torch")
    with judges.quiet():
        utils = importlib.import_module("pycvvdp.utils")
    light = np.geomspace(0.005, 1e4, 50)
    assert panel.pu21(light) == pytest.approx(utils.PU(type="banding_glare").encode(light))


def test_pu21_has_its_published_scale():
    """The authors' README: 100 cd/m² are near 256, and 0.005 cd/m² are 0."""
    assert panel.pu21(np.array([100.0, 0.005])) == pytest.approx([256, 0], abs=0.6)
    assert panel.pu21(np.array([0.0, 1e6])) == pytest.approx(panel.pu21(np.array([0.005, 1e4])))


def test_delta_e_itp_of_greys_is_720_times_the_difference_in_pq():
    """ST 2084 codes 100 cd/m² as 0.50808 and 10 cd/m² as 0.30152 (by its formula)."""

    def pq(nits):
        power = (nits / 1e4) ** (2610 / 16384)
        return ((3424 / 4096 + 18.8515625 * power) / (1 + 18.6875 * power)) ** 78.84375

    assert pq(100) == pytest.approx(0.50808, abs=5e-6)
    found = panel.delta_e_itp(even(1.0)[:, :, :24], even(0.1)[:, :, :24], LED)
    assert found == pytest.approx(720 * (pq(100) - pq(10)), rel=2e-4)


def test_delta_e_itp_of_a_colour_is_that_of_the_recommendation():
    """Red against green of BT.709 at 10 cd/m² of white, by the matrices of BT.2100 written out."""
    to_2020 = np.array(
        [[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]]
    )
    to_lms = np.array([[1688, 2146, 262], [683, 2951, 462], [99, 309, 3688]]) / 4096
    to_ictcp = np.array([[2048, 2048, 0], [6610, -13613, 7003], [17933, -17390, -543]]) / 4096

    def itp(rgb):
        power = (to_lms @ to_2020 @ rgb / 1e4) ** (2610 / 16384)
        coded = ((3424 / 4096 + 18.8515625 * power) / (1 + 18.6875 * power)) ** 78.84375
        return to_ictcp @ coded * [1, 0.5, 1]

    red, green = np.array([10.0, 0, 0]), np.array([0, 10.0, 0])
    lights = [np.tile(np.float32(rgb / 10), (1, 24, 24, 1)) for rgb in (red, green)]
    expected = 720 * np.linalg.norm(itp(red) - itp(green))
    assert panel.delta_e_itp(*lights, DOME) == pytest.approx(expected, rel=2e-3)


def test_psnr_is_that_of_the_pu21_values_over_the_area():
    """Near the rim domemaster pixels are smaller, by sin(theta) / theta: 0.7 at 81 degrees."""

    def error(col):
        light = even(0.2, size=96)[:, :, :96]
        light[:, 44:52, col : col + 8] = 0.4
        return 10 ** (-panel.pu21_psnr(even(0.2, size=96)[:, :, :96], light, DOME) / 10)

    assert error(1) / error(44) == pytest.approx(0.7, abs=0.03)
    first, second = panel.pu21(np.array([0.2, 0.4]) * PAIR.projector.white)
    found = panel.pu21_psnr(even(0.2, 0.2), even(0.4, 0.4), PAIR)
    assert found == pytest.approx(20 * np.log10(256 / (second - first)), abs=1e-3)
    assert panel.pu21_psnr(even(0.2), even(0.2), PAIR) == np.inf


def test_vsi_hangs_on_no_single_pixel():
    """Without dither, it is 0.989: `findings/piq-vsi-one-pixel.sh` says why."""
    pytest.importorskip("piq")
    down, across = np.mgrid[:256, :256] / 256
    glow = (np.exp(-((down - 0.9) ** 2) / 0.05) + 0.1) * (np.hypot(across - 0.5, down - 0.5) < 0.4)
    warm = (glow[None, ..., None] * [0.6, 0.3, 0.1]).astype(np.float32)
    other = warm.copy()
    other[0, 128, 242] = [0, 1e-4, 1e-4]
    assert chosen("PU21-VSI").judge(warm, other, LED) > 0.999


def test_light_above_full_scale_is_clipped_where_piq_insists():
    pytest.importorskip("piq")
    bright = [even(grey, size=168)[:, :, :168] for grey in (1.5, 3.0)]
    assert chosen("PU21-MS-SSIM").judge(*bright, LED) == pytest.approx(1)
    assert np.isfinite(panel.pu21_psnr(*bright, LED))


def test_fovvideovdp_knows_the_pixels_per_degree():
    pytest.importorskip("pyfvvdp")
    for density in (2.1, 6.98, 60.0):
        with judges.quiet(), panel._unwarned():
            metric = panel._metric(168, 200, density)
        assert metric.pix_per_deg == pytest.approx(density)


def test_fovvideovdp_leaves_colorvideovdp_its_modules():
    """Both packages call different modules `interp`."""
    pytest.importorskip("piq")
    before = judges.colorvideovdp(pair(), 0.5 * pair(), PAIR)
    panel._fovvideovdp.cache_clear()
    panel.fovvideovdp(pair(), 0.5 * pair(), PAIR)
    assert Path(sys.modules["interp"].__file__).parent.name == "pycvvdp"
    assert "pyfvvdp" not in {Path(folder).name for folder in sys.path}
    assert judges.colorvideovdp(pair(), 0.5 * pair(), PAIR) == before


@pytest.mark.parametrize(
    ("name", "package"),
    [("PU21-MS-SSIM", "piq"), ("FovVideoVDP", "pyfvvdp")],
    ids=["piq", "pyfvvdp"],
)
def test_a_missing_judge_says_how_to_get_it(monkeypatch, name, package):
    panel._fovvideovdp.cache_clear()
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(Missing, match=r"pip install 'domesim\[metrics\]'"):
        chosen(name).judge(pair(), pair(), PAIR)


def test_ssim_of_greys_is_the_published_formula():
    """Of even pictures only the luminance term remains (Wang et al. 2004, eq. 6, K1 = 0.01)."""
    pytest.importorskip("piq")
    low, high = panel.pu21(np.array([0.1, 0.6]) * PAIR.projector.white) / 256
    expected = (2 * low * high + 1e-4) / (low**2 + high**2 + 1e-4)
    found = panel.PU21("ssim")(even(0.1, 0.1), even(0.6, 0.6), PAIR)
    assert found == pytest.approx(expected, rel=1e-4)
