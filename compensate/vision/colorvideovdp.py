"""ColorVideoVDP itself, where it is installed (extra ``metrics``): of films, what changes in time.

`compensate.vision.differences` has its figure of stills. It judges films by two channels of the
eye, a sustained one and one of changes, and has been calibrated for them apart: the same frame
loses more as a film than as a still. So films are compared with films.

R. K. Mantiuk, P. Hanji, M. Ashraf, Y. Asano, A. Chapiro, "ColorVideoVDP: A visual difference
predictor for image, video and display distortions", ACM Trans. Graph. 43(4), 129 (2024).
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError

_BRIGHTEST, _DARKEST = 1e4, 0.005
"""Range of luminances, cd/m²: ColorVideoVDP clips below 0.005 in any case."""


def film_lost(
    wanted: Sequence[NDArray[np.float32]],
    seen: Sequence[NDArray[np.float32]],
    density: float,
    rate: float,
) -> float:
    """Returns how much worse a film looks than another, JOD.

    Parameters
    ----------
    wanted, seen
        Frames (row, col, RGB) of linear BT.709, cd/m².
    density
        Pixels per degree.
    rate
        Frames a second.

    Raises
    ------
    InputError
        If cvvdp is not installed.
    """
    library()
    rows, cols = wanted[0].shape[:2]
    films = (np.stack(frames) for frames in (seen, wanted))
    with quiet():
        metric = metric_of(cols, rows, density)
        quality, _ = metric.predict(*films, dim_order="FHWC", frames_per_second=rate)
    return 10 - float(quality)


@lru_cache(maxsize=4)
def metric_of(cols: int, rows: int, density: float, heatmap: str | None = None) -> Any:
    """ColorVideoVDP for pictures of that size, in cd/m², and pixels per degree."""
    cvvdp, torch = library()
    return cvvdp.cvvdp(
        display_photometry=cvvdp.vvdp_display_photo_eotf(
            _BRIGHTEST, contrast=_BRIGHTEST / _DARKEST, EOTF="linear"
        ),
        display_geometry=cvvdp.vvdp_display_geometry([cols, rows], ppd=density),
        heatmap=heatmap,
        device=torch.device("cpu"),
        quiet=True,
    )


@contextmanager
def quiet() -> Iterator[None]:
    """Turns off gradients, and log lines as `_unlogged` does."""
    _, torch = library()
    with _unlogged(), torch.no_grad():
        yield


@contextmanager
def _unlogged() -> Iterator[None]:
    """No log lines below errors: what domes show is below 1 cd/m², and warned of."""
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        yield
    finally:
        logging.disable(before)


@cache
def library() -> tuple[Any, Any]:
    """Imports ColorVideoVDP's module and torch, which takes seconds.

    Raises
    ------
    InputError
        If they are not installed.
    """
    try:
        import torch  # noqa: PLC0415

        try:
            import pycvvdp  # noqa: PLC0415
        except RuntimeError as error:
            if "torchvision::nms" not in str(error):
                raise
            # A torchvision for another torch lacks its compiled operators, which nobody calls here
            operators = torch.library.Library("torchvision", "FRAGMENT")
            for operator in ("nms", "qnms"):
                boxes = "(Tensor dets, Tensor scores, float iou_threshold) -> Tensor"
                operators.define(operator + boxes)
            import pycvvdp  # noqa: PLC0415

            pycvvdp.operators = operators  # they live as long as it does
    except ImportError as error:
        raise InputError("needs ColorVideoVDP: pip install 'domesim[metrics]'") from error
    return pycvvdp, torch
