"""Which files a show is: what cannot be meant is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from domesim.errors import InputError
from domesim.shows.show import find_show

SHOWS: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "nothing": ({}, ("wanted a master, or --left and --right", "got none", "name")),
    "left alone": ({"left": "l.exr"}, ("--left and --right", "l.exr only", "as --right")),
    "right alone": ({"right": "r.exr"}, ("--left and --right", "r.exr only", "as --left")),
    "master and left": (
        {"master": "m.exr", "left": "l.exr"},
        ("one master or --left and --right", "m.exr and", "l.exr", "leave one"),
    ),
    "unknown packing": (
        {"master": "m.exr", "packing": "diagonal"},
        ("'diagonal'", "side-by-side, top-bottom, side-by-side-half"),
    ),
    "packing of two files": (
        {"left": "l.exr", "right": "r.exr", "packing": "side-by-side"},
        ("--packing side-by-side", "one file of two views", "leave --packing out"),
    ),
    "unknown encoding": (
        {"master": "m.exr", "encoding": "rec709"},
        ("--encoding 'rec709' is not known", "st2084:p3-d65"),
    ),
}


@pytest.mark.parametrize("case", SHOWS)
def test_a_show_that_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, case: str) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("m.exr", "l.exr", "r.exr"):
        Path(name).touch()
    given, words = SHOWS[case]
    with pytest.raises(InputError) as refused:
        find_show(given.pop("master", None), **given)
    assert "\n" not in str(refused.value)
    for word in words:
        assert word in str(refused.value)
