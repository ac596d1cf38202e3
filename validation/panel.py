"""A panel of nine image-quality judges that nobody optimised for, to see where they agree.

`judges` holds FLIP and ColorVideoVDP. This file adds seven published metrics with the same call:
reference, test, scene -> figure. All take Light (view, row, col, primary), 1.0 = projector white,
and see it as `judges.on_display` shows it: linear BT.709, times the projector's white in cd/m².
Of a stereo pair the figure is the mean of the two eyes' figures.

Domes: Delta E ITP and PU21-PSNR are means over the screen's area, as FLIP is. The other new judges
give no map and pool over the whole rectangle. Its corners are black in both pictures and count as
perfect. This shifts the figures of a dome, so compare them only between pictures of one scene and
one size.

PU21 [1] turns cd/m² into units that are perceptually uniform, so that metrics for ordinary
displays judge dark pictures by what an eye sees there. As its authors do in `pu21_metric.m`, PSNR
and VSI take encoded R, G and B, and MS-SSIM takes encoded luminance. GMSD takes luminance
and MDSI takes R, G and B, as their own authors define them.

FovVideoVDP [2] runs without fixation: people look anywhere in a dome.

Each judge is blind to something, and tests pin what it is. ColorVideoVDP divides each picture by
its own surround: it hardly sees dimming. FovVideoVDP divides both by the reference's surround, of
at least 0.1 cd/m²: it does not see an even veil, but for its edge at a dome's rim.

[1] R. K. Mantiuk, M. Azimi, "PU21: A novel perceptually uniform encoding for adapting existing
quality metrics for HDR", Picture Coding Symposium (2021). [2] R. K. Mantiuk et al., "FovVideoVDP:
A visible difference predictor for wide field-of-view video", ACM Trans. Graph. 40(4), 49 (2021).
[3] Rec. ITU-R BT.2124-0, "Objective metric for the assessment of the potential visibility of
colour differences in television" (2019). [4] S. Kastryulin et al., "PyTorch Image Quality", arXiv
2208.14818 (2022): piq, the implementation of MS-SSIM, VSI, GMSD and MDSI.
"""

from __future__ import annotations

import importlib
import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.light import Light, on_host, require_finite, require_light
from domesim.observation.projector import conversion
from domesim.scene import Scene
from domesim.scene.loading import AnyScene, as_scene
from validation import judges
from validation.experiment import Missing

DARKEST, BRIGHTEST = 0.005, 1e4
"""Luminances, cd/m², that PU21 and FovVideoVDP are defined between; light beyond is clipped."""

PU21_PEAK = 256.0
"""PU21 units that count as full scale, those of 100 cd/m² (`pu21_metric.m` of gfxdisp/pu21)."""

_PU21 = (
    0.353487901,
    0.3734658629,
    8.277049286e-05,
    0.9062562627,
    0.09150303166,
    0.9099517204,
    596.3148142,
)


@final
@dataclass(frozen=True)
class Judge:
    """One judge of the panel.

    Attributes
    ----------
    name
        Name in reports.
    higher_is_better
        Whether a better picture has a higher figure.
    of_structure
        Whether it compares contrast, edges or spatial frequencies rather than pixels.
    judge
        Reference, test, scene -> figure. It raises `Missing` if its package is not installed, and
        ValueError if the pictures have not the same shape.
    """

    name: str
    higher_is_better: bool
    of_structure: bool
    judge: Callable[[Light, Light, Scene], float]


def pu21(luminance: NDArray[Any]) -> NDArray[np.float64]:
    """Perceptually uniform values of cd/m²: 0 at 0.005 cd/m², 256 at 100 cd/m².

    The variant is "banding_glare", which its authors recommend [1]. Its constants were compared,
    digit by digit, with the authors' `matlab/pu21_encoder.m` (repository gfxdisp/pu21) and with
    `pycvvdp.utils.PU` of cvvdp 0.5.7. A test compares them with the installed cvvdp.

    Parameters
    ----------
    luminance
        Luminance, or R, G or B so scaled that white has the luminance; cd/m², any shape.
    """
    p1, p2, p3, p4, p5, p6, p7 = _PU21
    power = np.clip(np.asarray(luminance, np.float64), DARKEST, BRIGHTEST) ** p4
    return np.asarray(p7 * (((p1 + p2 * power) / (1 + p3 * power)) ** p5 - p6))


def delta_e_itp(reference: Light, test: Light, scene: Scene) -> float:
    """Mean Delta E ITP [3] over the screen's area: 0 is the same, 1 is just noticeable at best.

    It compares pixels in absolute cd/m², after the PQ function and without regard to neighbours.

    Raises
    ------
    ValueError
        If the pictures have not the same shape.
    """
    return _mean_of_eyes("delta_e_itp", _delta_e_itp, reference, test, scene)


def pu21_psnr(reference: Light, test: Light, scene: Scene) -> float:
    """Peak signal-to-noise ratio of PU21 R, G and B over the screen's area, dB.

    The peak is `PU21_PEAK`. The figure of two equal pictures is infinite.

    Raises
    ------
    ValueError
        If the pictures have not the same shape.
    """
    return _mean_of_eyes("pu21_psnr", _pu21_psnr, reference, test, scene)


def fovvideovdp(reference: Light, test: Light, scene: Scene) -> float:
    """FovVideoVDP's quality [2] in just-objectionable differences (JOD): 10 is the same.

    It sees luminance only.

    Raises
    ------
    Missing
        If pyfvvdp is not installed.
    ValueError
        If the pictures have not the same shape.
    """
    _fovvideovdp()
    return _mean_of_eyes("fovvideovdp", _quality, reference, test, scene)


@final
@dataclass(frozen=True)
class PU21:
    """A metric of piq [4] on PU21 values, of which 0 to `PU21_PEAK` are full scale.

    Light above 100 cd/m² counts as 100 cd/m², as piq takes nothing above full scale.

    Parameters
    ----------
    metric
        piq's name of the metric.
    of_colours
        Whether the metric takes R, G and B; otherwise it takes luminance.
    smallest
        Pixels that the picture needs along its smaller side.
    of_codes
        Whether it takes 8-bit codes, rounded with dither, as the pictures that it was made for.
    """

    metric: str
    of_colours: bool = False
    smallest: int = 1
    of_codes: bool = False

    def __call__(self, reference: Light, test: Light, scene: Scene) -> float:
        """The metric's figure.

        Raises
        ------
        Missing
            If piq is not installed.
        ValueError
            If the pictures have not the same shape, or are too small.
        """
        _piq()
        return _mean_of_eyes(f"PU21 {self.metric}", self._figure, reference, test, scene)

    def _figure(self, reference: Light, test: Light, scene: Scene) -> float:
        if min(reference.shape[1:3]) < self.smallest:
            raise ValueError(
                f"PU21 {self.metric} takes pictures of at least {self.smallest} pixels a side, got "
                f"{reference.shape[1]} x {reference.shape[2]}; ask for a larger size"
            )
        with judges.quiet(), _unwarned():
            torch = importlib.import_module("torch")
            test_and_reference = (
                torch.from_numpy(self._encoded(light, scene)) for light in (test, reference)
            )
            return float(getattr(_piq(), self.metric)(*test_and_reference, data_range=1.0))

    def _encoded(self, light: Light, scene: Scene) -> NDArray[np.float32]:
        """(1, channel, row, col) PU21 values of one view, full scale = 1."""
        shown = _shown(light, scene)
        planes = shown if self.of_colours else shown @ conversion("BT.709", "XYZ")[1][:, None]
        # PU21 of 0.005 cd/m² misses 0 by a rounding error
        scaled = np.clip(pu21(planes) / PU21_PEAK, 0, 1)
        if self.of_codes:
            dither = np.random.default_rng(0).uniform(-0.5, 0.5, scaled.shape)
            scaled = np.clip(np.round(255 * scaled + dither), 0, 255) / 255
        scaled = scaled.astype(np.float32)
        return np.ascontiguousarray(scaled.transpose(2, 0, 1)[None])


PANEL: tuple[Judge, ...] = (
    Judge("ColorVideoVDP", True, True, judges.colorvideovdp),
    Judge("FLIP", False, False, judges.flip),
    Judge("Delta E ITP", False, False, delta_e_itp),
    Judge("PU21-PSNR", True, False, pu21_psnr),
    Judge("PU21-MS-SSIM", True, True, PU21("multi_scale_ssim", smallest=161)),
    Judge("PU21-VSI", True, True, PU21("vsi", of_colours=True, of_codes=True)),
    Judge("PU21-GMSD", False, True, PU21("gmsd")),
    Judge("PU21-MDSI", False, True, PU21("mdsi", of_colours=True)),
    Judge("FovVideoVDP", True, True, fovvideovdp),
)
"""All nine, with one vote each. MS-SSIM needs 161 pixels along the smaller side.

VSI takes 8-bit codes: its saliency has a step at the least a* and b* of a picture. Where that is
the black beside a dome, one pixel that differs by a tenth of a code changes VSI by 0.01
(``findings/piq-vsi-one-pixel.sh``), and a sky by 0.12. Dither takes the step away, and changes the
mean of the choosing half, of light that is untouched, by 0.001.
"""


def _mean_of_eyes(
    who: str,
    figure: Callable[[Light, Light, Scene], float],
    reference: Light,
    test: Light,
    scene: Scene,
) -> float:
    require_light(reference, who=who)
    require_light(test, reference.shape, who=who)
    eyes = [slice(v, v + 1) for v in range(len(reference))]
    return float(np.mean([figure(reference[eye], test[eye], scene) for eye in eyes]))


def _shown(light: Light, scene: Scene) -> NDArray[np.float32]:
    """(row, col, RGB) of one view in cd/m²."""
    return judges.on_display(light, scene) * np.float32(scene.projector.white)


def _mean(values: NDArray[Any], scene: Scene) -> float:
    """Mean of (row, col) values over the screen's area."""
    areas = scene.pixel_areas(*values.shape)
    return float(np.sum(areas * values) / areas.sum())


def _delta_e_itp(reference: Light, test: Light, scene: Scene) -> float:
    with _unwarned():
        colour = importlib.import_module("colour")
    to_2020 = conversion("BT.709", "BT.2020").T
    first, second = (
        colour.RGB_to_ICtCp(_shown(light, scene) @ to_2020, method="ITU-R BT.2100-2 PQ")
        for light in (reference, test)
    )
    return _mean(colour.difference.delta_E_ITP(first, second), scene)


def _pu21_psnr(reference: Light, test: Light, scene: Scene) -> float:
    first, second = (pu21(_shown(light, scene)) for light in (reference, test))
    error = _mean(((second - first) ** 2).mean(axis=-1), scene)
    return float(10 * np.log10(PU21_PEAK**2 / error)) if error > 0 else float("inf")


def _quality(reference: Light, test: Light, scene: Scene) -> float:
    """FovVideoVDP's JOD of one view."""
    rows, cols = reference.shape[1:3]
    times, density = judges.enlargement(scene, rows, cols)
    shown = (judges.enlarged(_shown(light, scene), times) for light in (test, reference))
    with judges.quiet(), _unwarned():
        quality, _ = _metric(rows * times, cols * times, density).predict(*shown, dim_order="HWC")
    return float(quality)


@lru_cache(maxsize=4)
def _metric(rows: int, cols: int, density: float) -> Any:
    """FovVideoVDP for pictures of that size and pixels per degree."""
    fvvdp, torch = _fovvideovdp(), importlib.import_module("torch")
    # Its geometry knows no pixels per degree; without fixation it uses those of the centre only
    half = np.arctan(cols * np.tan(np.radians(0.5 / density)))
    geometry = fvvdp.fvvdp_display_geometry(
        [cols, rows], distance_m=1.0, fov_horizontal=float(np.degrees(2 * half))
    )
    return fvvdp.fvvdp(
        display_photometry=fvvdp.fvvdp_display_photo_absolute(BRIGHTEST, DARKEST),
        display_geometry=geometry,
        foveated=False,
        quiet=True,
        device=torch.device("cpu"),
    )


def _piq() -> ModuleType:
    with judges.quiet(), _unwarned():
        try:
            return importlib.import_module("piq")
        except ImportError as error:
            raise Missing("needs piq: pip install 'domesim[metrics]'") from error


@cache
def _fovvideovdp() -> ModuleType:
    """Its module.

    pyfvvdp and pycvvdp both put their folders on sys.path, and both import `interp` and
    `third_party` from there. The modules of these names differ, and whichever package came second
    would fail or get the other's. So pycvvdp's are put aside meanwhile, and pyfvvdp's afterwards.
    """

    def shared() -> list[str]:
        return [n for n in sys.modules if n.partition(".")[0] in ("interp", "third_party")]

    with judges.quiet(), _unwarned():
        aside, path = {name: sys.modules.pop(name) for name in shared()}, list(sys.path)
        sys.path[:] = [folder for folder in path if Path(folder).name != "pycvvdp"]
        try:
            return importlib.import_module("pyfvvdp")
        except ImportError as error:
            raise Missing("needs FovVideoVDP: pip install 'domesim[metrics]'") from error
        finally:
            for name in shared():
                del sys.modules[name]
            sys.modules.update(aside)
            sys.path[:] = path


def _unwarned() -> AbstractContextManager[Any]:
    """Hides other packages' warnings, of which the reader of a figure can change nothing."""
    return warnings.catch_warnings(action="ignore")


def judge(
    wanted: Light, seen: Light, scene: AnyScene, *, by: Sequence[str] = ()
) -> dict[str, float | None]:
    """Asks the panel how a picture looks beside what is wanted.

    Parameters
    ----------
    wanted, seen
        (view, row, col, primary) of one shape, 1.0 = projector white.
    scene
        Where; or its name or file.
    by
        Names of judges; all of `PANEL` by default.

    Returns
    -------
    said
        Figure by the judge's name; None of one that is not installed.

    Raises
    ------
    InputError
        If there is no such judge, or the pictures are no light of one shape.
    """
    known = {each.name: each for each in PANEL}
    if unknown := [name for name in by if name not in known]:
        raise InputError(f"no judge is called {', '.join(unknown)}; use {', '.join(known)}")
    require_light(wanted, who="judge")
    for light in (wanted, seen):
        require_light(light, tuple(wanted.shape), who="judge", primaries=3)
        require_finite(light, who="judge")
    place, first, second = as_scene(scene), on_host(wanted), on_host(seen)
    return {
        name: judges.if_installed(known[name].judge, first, second, place) for name in (by or known)
    }
