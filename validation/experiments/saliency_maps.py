"""Saliency is that of its authors' own program.

Rationale
    `predict --saliency` weighs by graph-based visual saliency (Harel et al. 2007). Their program
    leaves no choice open, and the paper many. Some of it is GPL, so none of it may be here: this
    experiment compares with maps that somebody made with it. `validation/notes/0013-saliency.md`
    says how. The folder that DOMESIM_GBVS names has pictures, as 8-bit sRGB, and beside each a
    table of the same name: `fog.png`, and `fog.csv` with the program's `master_map`.
Expected
    Each picture's map, averaged onto the program's grid, correlates with its map by 0.95 or more.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from compensate.vision.saliency import gbvs
from domesim.errors import InputError
from domesim.frames import read_frame
from domesim.light.transfer import SRGB
from validation.experiment import Column, Finding, Missing, Table, Work, at_least

FOLDER = "DOMESIM_GBVS"
"""Environment variable that names the folder of pictures and maps."""
WANTED = 0.95

Floats = NDArray[np.float64]


def correlation(picture: Path) -> float:
    """Correlation of a picture's map with the one beside it.

    Raises
    ------
    InputError
        If a file is none, or the picture is smaller than its map.
    """
    try:
        theirs = np.loadtxt(picture.with_suffix(".csv"), delimiter=",", ndmin=2)
    except (OSError, ValueError) as reason:
        raise InputError(f"{picture.with_suffix('.csv')} is no table of a map: {reason}") from None
    ours = np.asarray(gbvs(_light(picture)), np.float64)
    return float(np.corrcoef(_averaged(ours, theirs.shape).ravel(), theirs.ravel())[0, 1])


def _light(picture: Path) -> Floats:
    return np.asarray(SRGB().decode(read_frame(picture).pixels.astype(np.float64)))


def _averaged(ours: Floats, shape: tuple[int, ...]) -> Floats:
    """Means over the areas of the coarser grid, by differences of running sums."""
    for axis, count in enumerate(shape):
        size = ours.shape[axis]
        if size < count:
            raise InputError(f"a map of {shape} is larger than its picture, {ours.shape}")
        sums = np.insert(np.cumsum(ours, axis), 0, 0, axis)
        place = np.linspace(0, size, count + 1)
        low = np.minimum(place.astype(int), size - 1)
        part = np.expand_dims(place - low, 1 - axis)
        edges = np.take(sums, low, axis) * (1 - part) + np.take(sums, low + 1, axis) * part
        ours = np.diff(edges, axis=axis) * count / size
    return ours


def run(work: Work) -> Finding:
    """Compare all maps that there are."""
    folder = os.environ.get(FOLDER)
    if not folder:
        raise Missing(
            f"maps of the authors' program: make some (validation/notes/0013-saliency.md), and set "
            f"{FOLDER} to their folder"
        )
    pictures = [
        path.with_suffix(".png")
        for path in sorted(Path(folder).glob("*.csv"))
        if path.with_suffix(".png").is_file()
    ]
    if not pictures:
        raise Missing(
            f"maps of the authors' program: {folder} has no picture NAME.png with NAME.csv"
        )
    found = {path.stem: correlation(path) for path in pictures}
    mean, least = float(np.mean(list(found.values()))), min(found.values())
    return Finding(
        result=(
            f"On {len(found)} pictures our maps correlate with those of the authors' program by "
            f"{mean:.3f} in the mean, {least:.3f} at least."
        ),
        checks=(at_least("least correlation with the authors' program", least, WANTED),),
        tables=(
            Table(
                caption="Correlation with the map of the authors' program, over its grid.",
                columns=(Column(name="picture"), Column(name="correlation", digits=".3f")),
                rows=tuple(found.items()),
            ),
        ),
        figures={"saliency.mean": mean, "saliency.least": least},
    )
