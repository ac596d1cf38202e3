"""Scene files written by the program."""

from __future__ import annotations

import tomllib
from importlib import resources

import pytest

from domesim.scene import scene_names
from domesim.scene.writing import as_toml


@pytest.mark.parametrize("name", scene_names())
def test_scenes_survive_being_written(name):
    content = tomllib.loads(resources.files("scenes").joinpath(f"{name}.toml").read_text())
    assert tomllib.loads(as_toml(content)) == content


def test_awkward_text_and_numbers_survive():
    content = {
        "a key": 'quoted "text"\n\x7f é',
        "flag": True,
        "tiny": 1e-30,
        "empty": [],
        "rows": [[1, 2], [3.5, 4]],
        "table": {"dotted.key": {"deep": [{"x": 1}, {"x": 2, "inner": {"y": "z"}}]}},
    }
    assert tomllib.loads(as_toml(content)) == content


def test_what_toml_has_no_word_for():
    with pytest.raises(TypeError, match="got NoneType"):
        as_toml({"a": None})
