"""The reference of scene keys is that of the models, and its examples are valid."""

from __future__ import annotations

from pathlib import Path

import jsonschema
import pytest

from domesim.scene.dome_file import DomeFile
from domesim.scene.flat_file import CinemaFile
from domesim.scene.reference import page, parts
from domesim.scene.stereo_file import StereoFile

PAGE = Path(__file__).parents[3] / "docs" / "scene-keys.md"


def test_the_page_is_up_to_date():
    assert page() == PAGE.read_text(), "make keys writes it anew"


@pytest.mark.parametrize("model", [DomeFile, StereoFile, CinemaFile])
def test_every_key_has_an_example_that_the_model_takes(model):
    keys = [key for part in parts(model) for key in part.keys]
    assert len(keys) > 30
    for key in keys:
        jsonschema.validate(key.example, key.schema)
        assert key.example is not None, key
