"""Stored arrays are looked at before they are unpacked."""

from __future__ import annotations

import io
import os
import resource
import zipfile
from pathlib import Path

import numpy as np
import pytest

from domesim.errors import InputError
from domesim.host.arrays import read_arrays, write_arrays


@pytest.fixture(scope="module")
def bomb() -> tuple[bytes, bytes]:
    """A quarter of a gigabyte of zeros, in little; and its size, as the file says it."""
    path = io.BytesIO()
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f4", "fortran_order": False, "shape": (1 << 26,)}
    )
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as package:
        for name in ("format", "sha256"):
            content = io.BytesIO()
            np.save(content, np.array("x"))
            package.writestr(f"{name}.npy", content.getvalue())
        with package.open("zeros.npy", "w", force_zip64=True) as entry:
            entry.write(header.getvalue())
            for _ in range(1 << 8):
                entry.write(bytes(1 << 20))
    size = (len(header.getvalue()) + (1 << 28)).to_bytes(4, "little")
    assert size in path.getvalue()
    return path.getvalue(), size


@pytest.mark.parametrize("claims", [None, 100])
def test_a_bomb_is_refused_before_it_goes_off(
    tmp_path: Path, bomb: tuple[bytes, bytes], claims: int | None
) -> None:
    """Also one whose directory says less than there is."""
    content, size = bomb
    path = tmp_path / "a.npz"
    path.write_bytes(content.replace(size, claims.to_bytes(4, "little")) if claims else content)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(InputError, match=r"at most 128 MiB|none or damaged"):
        read_arrays(path, "x", "transport", ("zeros",))
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200 << 10  # kB


def test_numbers_that_are_well_packed_are_read(tmp_path: Path) -> None:
    path, zeros = tmp_path / "a.npz", np.zeros(1 << 23, np.float32)
    write_arrays(path, {"format": "x", "zeros": zeros})
    assert os.path.getsize(path) < zeros.nbytes // 100  # noqa: PTH202
    assert np.array_equal(read_arrays(path, "x", "transport", ("zeros",))["zeros"], zeros)
