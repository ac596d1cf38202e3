"""Stored crosstalk maps: what was traced of a stereo system's hardware, by seat."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.host.arrays import read_arrays, write_arrays

FORMAT = "domesim crosstalk maps 1"


@final
@dataclass(frozen=True)
class CrosstalkMaps:
    """Maps of several seats.

    Parameters
    ----------
    seats
        Their names.
    share, standard_error
        (seat, eye, row, col) the other picture's light over the eye's own, and its error.
    changes
        (seat, change, eye, row, col) what independent errors, one standard deviation each, change
        it by; None if they are not known as such.
    matrix_changes
        Likewise (change, eye, primary, primary) of the scene's matrices.
    provenance
        From what scene it is, and how it was made, as plain JSON.
    """

    seats: tuple[str, ...]
    share: NDArray[np.float64]
    standard_error: NDArray[np.float64]
    provenance: Mapping[str, Any]
    changes: NDArray[np.float64] | None = None
    matrix_changes: NDArray[np.float64] | None = None

    def save(self, path: Path) -> None:
        """Write the file, whole or not at all.

        Raises
        ------
        InputError
            If it cannot be written.
        """
        facts = {"seats": self.seats, **self.provenance}
        arrays = {
            "format": np.array(FORMAT),
            "share": self.share,
            "standard_error": self.standard_error,
            "facts": np.array(json.dumps(facts, sort_keys=True)),
        }
        if self.changes is not None and self.matrix_changes is not None:
            arrays |= {"changes": self.changes, "matrix_changes": self.matrix_changes}
        write_arrays(path, arrays)


def load_maps(path: Path) -> CrosstalkMaps:
    """Read a file that `CrosstalkMaps.save` wrote.

    Raises
    ------
    InputError
        If it is no such file, or damaged.
    """
    arrays = read_arrays(path, FORMAT, "crosstalk map", ("share", "standard_error", "facts"))
    try:
        facts = json.loads(str(arrays["facts"]))
        seats, share = tuple(facts.pop("seats")), arrays["share"]
        whole = share.ndim == 4 and share.shape[:2] == (len(seats), 2) and np.isfinite(share).all()
        if not whole or arrays["standard_error"].shape != share.shape:
            raise ValueError(f"shape {share.shape}")
        changes, matrices = (arrays.get(name) for name in ("changes", "matrix_changes"))
        if changes is not None and (len(changes), *changes.shape[2:]) != share.shape:
            raise ValueError(f"shape {changes.shape}")
        if matrices is not None and matrices.shape[1:] != (2, 3, 3):
            raise ValueError(f"shape {matrices.shape}")
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(
            f"{path}: wanted crosstalk maps stored by 'domesim tabulate', these are damaged"
        ) from error
    return CrosstalkMaps(seats, share, arrays["standard_error"], facts, changes, matrices)
