"""A stereo system whose crosstalk and projectors were measured: readings -> what a scene needs.

Light of such a scene is in the common gamut of both projectors (`domesim.readings.gamut`): its
primaries are the scene's, its white is light 1.0, and crosstalk is between pictures in it.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.observation.projector import MEASURED, Projector, relative_primaries
from domesim.scene.fields import response_of
from domesim.scene.stereo_file import CrosstalkSection, MeasuredProjectorSection

if TYPE_CHECKING:
    from domesim.readings.pair import MeasuredPair

AGREEMENT = 0.02
"""Share by which figures of the scene file may differ from those of the readings: rounding."""


@final
@dataclass(frozen=True, eq=False)
class MeasuredSystem:
    """A stereo system by its readings.

    Parameters
    ----------
    projector
        What an eye sees of its own projector, in the common gamut.
    black
        (view, primary) light of both projectors' black through the glasses, as the luminance of a
        white picture that has as much of this primary, cd/m².
    matrices
        (view, primary, primary) crosstalk between pictures in the common gamut.
    uncertainty
        (change, view, primary, primary) of it, one standard deviation each.
    digest
        SHA-256 of the readings.
    """

    projector: Projector
    black: NDArray[np.float64]
    matrices: NDArray[np.float64]
    uncertainty: NDArray[np.float64]
    digest: str


def measured_system(
    crosstalk: CrosstalkSection, projector: MeasuredProjectorSection, folder: Path
) -> MeasuredSystem:
    """The stereo system of a scene file in `folder` that names readings.

    Raises
    ------
    InputError
        If the readings cannot be read, do not fit together, or tell other figures than the scene
        file.
    """
    # Takes SciPy's optimisers and distributions along, which other scenes do not need
    from domesim.readings.meter import read_readings  # noqa: PLC0415
    from domesim.readings.pair import measured_pair  # noqa: PLC0415

    assert crosstalk.readings is not None
    path = folder / crosstalk.readings
    readings = read_readings(path, black=crosstalk.black)
    pair = measured_pair(readings, allow_negative=bool(crosstalk.allow_negative))
    white = float(pair.gamut.white[1])
    seen = [crosstalk.black for crosstalk in pair.crosstalk]
    luminances = [float(xyz[1]) for xyz in seen if xyz is not None]
    black = float(np.mean(luminances)) if luminances else projector.black_cd_m2 or 0.0
    _require_agreement("white_cd_m2", projector.white_cd_m2, white, path)
    _require_agreement("black_cd_m2", projector.black_cd_m2, black, path)
    return MeasuredSystem(
        Projector(
            MEASURED,
            white,
            black,
            relative_primaries(pair.gamut.primaries),
            response_of(projector),
        ),
        white * np.stack([_light(pair, xyz, black / white) for xyz in seen]),
        pair.common_matrices,
        pair.common_uncertainty,
        hashlib.sha256(b"".join(file.read_bytes() for file in readings.files)).hexdigest(),
    )


def _light(
    pair: MeasuredPair, xyz: NDArray[np.float64] | None, unread: float
) -> NDArray[np.float64]:
    """(primary,) that look like this black; `unread` each if it was not read."""
    if xyz is None:
        return np.full(3, unread)
    # A black more saturated than the primaries is shown as the nearest that they can.
    return np.asarray(np.maximum(np.linalg.solve(pair.gamut.primaries, xyz), 0))


def _require_agreement(key: str, stated: float | None, measured: float, path: Path) -> None:
    if stated is None or abs(stated - measured) <= AGREEMENT * measured:
        return
    raise InputError(
        f"projector.{key}: must be that of the readings, {measured:.4g} ({path.name}), got "
        f"{stated:g}; leave it out. Whether pictures keep the black, [grade] black says, or --black"
    )
