"""Judges that nobody optimised for: two published metrics.

The objective of the compensation cannot show that the objective is right. FLIP [1] and
ColorVideoVDP [2] are others' models of visible differences. Both take Light (view, row, col,
primary), 1.0 = projector white, of a domemaster, and see only the dome's circle: outside it both
pictures are black; or of left and right, which the metrics judge one by one: their mean is given.

FLIP comes in two kinds. Here it is LDR-FLIP on sRGB-coded light, projector white = display white:
its colour differences are relative to a display's white, as the projector's is the brightest that
the audience sees. HDR-FLIP brightens the pictures up to where their median is nearly white and
keeps the worst; in a night scene of 0.05 cd/m² it would count what no eye in the dome sees. Even so
FLIP is strict in the shadows: it thinks of a desktop display's luminance. ColorVideoVDP takes cd/m²
and knows how dark it is.

[1] P. Andersson et al., "FLIP: A Difference Evaluator for Alternating Images", Proc. ACM Comput.
Graph. Interact. Tech. 3(2), 15 (2020). [2] R. K. Mantiuk, P. Hanji, M. Ashraf, Y. Asano, A.
Chapiro, "ColorVideoVDP: A visual difference predictor for image, video and display distortions",
ACM Trans. Graph. 43(4), 129 (2024).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compensate.vision.colorvideovdp import library, metric_of
from compensate.vision.colorvideovdp import quiet as colorvideovdp_quiet
from domesim.errors import InputError
from domesim.light import Light, require_light
from domesim.light.guarded import guarded
from domesim.light.transfer import named
from domesim.scene import Scene
from validation.experiment import Missing

COARSEST = 2.0
"""Pixels per degree below which FLIP's edge detectors fall between the pixels: from 1.8 on they
count every difference as one of an edge."""


@guarded
def flip(reference: Light, test: Light, scene: Scene) -> float:
    """Mean LDR-FLIP over the screen's area: 0 is the same, 1 as far apart as can be.

    Light above projector white counts as white, colours outside BT.709 as its nearest.

    Parameters
    ----------
    reference, test
        (view, row, col, primary) what should be seen and what is, 1.0 = projector white.
    scene
        Where.

    Returns
    -------
    error
        0 to 1.

    Raises
    ------
    Missing
        If flip-evaluator is not installed.
    InputError
        If one is no light, or they have not the same shape.
    """
    try:
        import flip_evaluator  # noqa: PLC0415
    except ImportError as error:
        raise Missing("needs FLIP: pip install 'domesim[metrics]'") from error
    require_light(test, reference.shape, who="flip")
    if len(reference) > 1:
        return _of_both(flip, reference, test, scene)
    times, density = enlargement(scene, *reference.shape[1:3])
    curve = named("srgb", white=1.0)
    shown = (
        enlarged(curve.encode(np.minimum(on_display(light, scene), 1)), times)
        for light in (reference, test)
    )
    each, _, _ = flip_evaluator.evaluate(*shown, "LDR", True, False, False, {"ppd": density})
    rows, cols = reference.shape[1:3]
    return _mean(each.reshape(rows, times, cols, times).mean((1, 3)), scene)


@guarded
def colorvideovdp(reference: Light, test: Light, scene: Scene) -> float:
    """Quality in just-objectionable differences (JOD): 10 is the same, 9 is seen to be worse.

    Of two pictures that are 1 JOD apart, 75 of 100 people prefer the better. Light below 0.005
    cd/m² and colours outside BT.709 are clipped.

    Parameters
    ----------
    reference, test
        (view, row, col, primary) what should be seen and what is, 1.0 = projector white.
    scene
        Where.

    Returns
    -------
    quality
        JOD.

    Raises
    ------
    Missing
        If cvvdp is not installed.
    InputError
        If one is no light, or they have not the same shape.
    """
    _colorvideovdp()
    require_light(test, reference.shape, who="colorvideovdp")
    if len(reference) > 1:
        return _of_both(colorvideovdp, reference, test, scene)
    return _predicted(reference, test, scene)[0]


@guarded
def colorvideovdp_map(
    reference: Light, test: Light, scene: Scene
) -> tuple[float, NDArray[np.float32]]:
    """`colorvideovdp`, and the (view, row, col) quality lost at each pixel: its raw heatmap, JOD.

    It is local: what a whole picture loses, if all of it looked like that pixel.

    Parameters
    ----------
    reference, test
        (view, row, col, primary) what should be seen and what is, 1.0 = projector white.
    scene
        Where.

    Returns
    -------
    quality, lost
        Both in JOD.

    Raises
    ------
    Missing
        If cvvdp is not installed.
    InputError
        If one is no light, or they have not the same shape.
    """
    _colorvideovdp()
    require_light(test, reference.shape, who="colorvideovdp_map")
    eyes = [slice(v, v + 1) for v in range(len(reference))]
    found = [_predicted(reference[eye], test[eye], scene, "raw") for eye in eyes]
    return float(np.mean([quality for quality, _ in found])), np.stack([lost for _, lost in found])


def if_installed(
    judge: Callable[[Light, Light, Scene], float], reference: Light, test: Light, scene: Scene
) -> float | None:
    """Asks a judge that may not be installed.

    Parameters
    ----------
    judge
        One of this module's.
    reference, test, scene
        As it takes them.

    Returns
    -------
    said
        None if it is not installed.
    """
    try:
        return judge(reference, test, scene)
    except Missing:
        return None


def left_out(said: Mapping[str, Iterable[float | None]]) -> list[str]:
    """Why judges were left out of a report.

    Parameters
    ----------
    said
        Name of a judge -> what it said of each picture, None where it is not installed.
    """
    return [
        f"{judge}: it needs pip install 'domesim[metrics]'"
        for judge, verdicts in said.items()
        if any(verdict is None for verdict in verdicts)
    ]


@guarded(light="view row col 3")
def luminance(light: Light, scene: Scene) -> NDArray[np.float64]:
    """Computes the luminance of light.

    Parameters
    ----------
    light
        (view, row, col, primary).
    scene
        Whose projector it is of.

    Returns
    -------
    luminance
        (view, row, col), white = 1.
    """
    return np.asarray(np.asarray(light, np.float64) @ scene.projector.luminance_weights)


def _of_both(
    judge: Callable[[Light, Light, Scene], float], reference: Light, test: Light, scene: Scene
) -> float:
    eyes = [(slice(v, v + 1),) for v in range(len(reference))]
    return float(np.mean([judge(reference[eye], test[eye], scene) for eye in eyes]))


def _predicted(
    reference: Light, test: Light, scene: Scene, heatmap: str | None = None
) -> tuple[float, NDArray[np.float32]]:
    """ColorVideoVDP's JOD of one view and a (row, col) heatmap: JOD lost, 0 if not asked for."""
    rows, cols = reference.shape[1:3]
    shown = [_shown(light, scene) for light in (test, reference)]
    with quiet():
        quality, stats = _metric(scene, rows, cols, heatmap).predict(*shown, dim_order="HWC")
    lost = np.zeros((rows, cols), np.float32)
    if heatmap is not None:
        # It is of half precision, and in shares of 10 JOD
        fine = 10 * stats["heatmap"][0, 0, 0].float().numpy()
        times, _ = enlargement(scene, rows, cols)
        lost[:] = fine.reshape(rows, times, cols, times).mean((1, 3))
    return float(quality), lost


def _metric(scene: Scene, rows: int, cols: int, heatmap: str | None = None) -> Any:
    """ColorVideoVDP for pictures of that size, `_shown`."""
    times, density = enlargement(scene, rows, cols)
    return metric_of(cols * times, rows * times, density, heatmap)


def _shown(light: Light, scene: Scene) -> NDArray[np.float32]:
    """(row, col, RGB) of one view in cd/m², as ColorVideoVDP takes it."""
    times, _ = enlargement(scene, *light.shape[1:3])
    return enlarged(on_display(light, scene), times) * np.float32(scene.projector.white)


@guarded(light="view row col 3")
def on_display(light: Light, scene: Scene) -> NDArray[np.float32]:
    """Converts light of one view for a display.

    Parameters
    ----------
    light
        (1, row, col, primary).
    scene
        Whose projector it is of.

    Returns
    -------
    shown
        (row, col, RGB) linear light in BT.709, at least 0; black outside the screen.
    """
    inside = scene.screen(*light.shape[1:3])[..., None]
    shown = np.where(inside, np.maximum(scene.projector.to_display(light)[0], 0), 0)
    return np.asarray(shown, np.float32)


def enlargement(scene: Scene, rows: int, cols: int) -> tuple[int, float]:
    """Finds how large pixels must be for judges, which see their edges.

    Parameters
    ----------
    scene
        Where.
    rows, cols
        Size of a view, pixels.

    Returns
    -------
    times, density
        How often a pixel is repeated, and pixels per degree then.
    """
    density = scene.viewing.pixels_per_degree(rows, cols)
    times = max(1, int(np.ceil(COARSEST / density)))
    return times, times * density


def enlarged(picture: NDArray[Any], times: int) -> NDArray[Any]:
    """Repeats each pixel of a picture.

    Parameters
    ----------
    picture
        (row, col, ...).
    times
        How often, in both directions.

    Returns
    -------
    enlarged
        (times row, times col, ...).
    """
    return np.ascontiguousarray(picture.repeat(times, axis=0).repeat(times, axis=1))


def _mean(values: NDArray[Any], scene: Scene) -> float:
    """Mean of (row, col) values over the screen's area."""
    areas = scene.pixel_areas(*values.shape)
    return float(np.sum(areas * values) / areas.sum())


@contextmanager
def quiet() -> Iterator[None]:
    """Turns off gradients, and log lines below errors.

    Raises
    ------
    Missing
        If cvvdp is not installed.
    """
    _colorvideovdp()
    with colorvideovdp_quiet():
        yield


def _colorvideovdp() -> None:
    """Imports ColorVideoVDP, which takes seconds."""
    try:
        library()
    except InputError as error:
        raise Missing(str(error)) from None
