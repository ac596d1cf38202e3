"""Cores: by affinity, and by control groups of both versions."""

from __future__ import annotations

import math
import os
from pathlib import Path

import pytest
from dask.system import cpu_count

from domesim.host.cores import _quota, cores


def test_they_are_what_dask_counts() -> None:
    assert cores() == cpu_count()
    assert 1 <= cores() <= (os.cpu_count() or 1)


@pytest.mark.parametrize(
    ("name", "content", "wanted"),
    [
        ("cpu.max", "150000 100000", 1.5),
        ("cpu.max", "max 100000", math.inf),
        ("cpu,cpuacct", ("200000", "100000"), 2.0),
        ("cpuacct,cpu", ("-1", "100000"), math.inf),
        ("nothing", "", math.inf),
    ],
)
def test_quotas_of_control_groups(
    tmp_path: Path, name: str, content: str | tuple[str, str], wanted: float
) -> None:
    if isinstance(content, str):
        (tmp_path / name).write_text(content)
    else:
        (tmp_path / name).mkdir()
        for kind, value in zip(("quota", "period"), content, strict=True):
            (tmp_path / name / f"cpu.cfs_{kind}_us").write_text(value)
    assert _quota(tmp_path) == wanted
