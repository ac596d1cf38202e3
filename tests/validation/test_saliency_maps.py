"""The comparison with the authors' program takes the form of files that the note asks for."""

from __future__ import annotations

import numpy as np
import pytest
from image_files import store

from compensate.vision.saliency import gbvs
from domesim.errors import InputError
from domesim.light.transfer import SRGB
from validation.experiment import Missing, Work
from validation.experiments import saliency_maps


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Two pictures: one with the map that we find, one with another's."""
    rng = np.random.default_rng(0)
    for name in "ab":
        codes = rng.integers(0, 256, (96, 128, 3)).astype(np.uint8)
        codes[30:50, 40:70] = rng.integers(0, 256, 3)
        store(tmp_path / f"{name}.png", codes)
        ours = gbvs(SRGB().decode(codes / 255.0))
        theirs = ours.reshape(24, 4, 32, 4).mean((1, 3))
        if name == "b":
            theirs = theirs[::-1, ::-1]
        np.savetxt(tmp_path / f"{name}.csv", theirs, delimiter=",")
    monkeypatch.setenv(saliency_maps.FOLDER, str(tmp_path))
    return tmp_path


def test_maps_of_another_program_are_compared(folder):
    found = saliency_maps.run(Work(quick=True))
    same, other = (dict(found.tables[0].rows)[name] for name in "ab")
    assert same == pytest.approx(1, abs=1e-6)
    assert other < 0.9
    assert not found.passed
    for each in folder.glob("b.*"):
        each.unlink()
    assert saliency_maps.run(Work(quick=True)).passed


def test_maps_that_are_not_there_are_asked_for(tmp_path, monkeypatch):
    monkeypatch.delenv(saliency_maps.FOLDER, raising=False)
    with pytest.raises(Missing, match="set DOMESIM_GBVS to their folder"):
        saliency_maps.run(Work(quick=True))
    monkeypatch.setenv(saliency_maps.FOLDER, str(tmp_path))
    with pytest.raises(Missing, match=r"has no picture NAME\.png"):
        saliency_maps.run(Work(quick=True))


def test_what_is_no_map_is_refused(folder):
    (folder / "a.csv").write_text("a map\n")
    with pytest.raises(InputError, match=r"a\.csv is no table of a map"):
        saliency_maps.correlation(folder / "a.png")
    np.savetxt(folder / "a.csv", np.ones((200, 200)), delimiter=",")
    with pytest.raises(InputError, match="larger than its picture"):
        saliency_maps.correlation(folder / "a.png")
