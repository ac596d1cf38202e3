"""How Sphinx makes the site; ``make docs``.

The source folder is the repository: links between files are right there, and so they are here.
"""

from __future__ import annotations

import shutil
import types
from pathlib import Path
from typing import Any

import domesim
from domesim.commands import manual

HERE = Path(__file__).parent

project = "domesim"
author = "The domesim developers"
release = version = domesim.__version__
root_doc = "docs/index"
include_patterns = ["docs/**", "validation/notes/**", "CHANGELOG.md"]
exclude_patterns = [
    ".*",
    "out",
    "**/__pycache__",
    "docs/examples",
    "docs/farm",
    "docs/start",
    "docs/templates",
]
extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx_gallery.gen_gallery",
]

html_theme = "furo"
html_title = f"domesim {release}"
html_copy_source = False
html_show_copyright = False
html_extra_path = [str(HERE / "start")]
highlight_language = "none"
smartquotes = False  # "--" begins an option
myst_heading_anchors = 3
templates_path = [str(HERE / "templates")]
autodoc_typehints = "none"
numpydoc_show_class_members = False
sphinx_gallery_conf = {
    "examples_dirs": str(HERE / "examples"),
    "gallery_dirs": str(HERE / "gallery"),
    "filename_pattern": "/[a-z]",
    "show_memory": False,
    "show_signature": False,
    "write_computation_times": False,
    "min_reported_time": 1e9,
    "remove_config_comments": True,
    "abort_on_example_error": True,
}


def _escaped(
    app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]
) -> None:  # docstrings are plain text in which |x| is a length
    lines[:] = [line.replace("|", "\\|") for line in lines]


def _skipped(app: Any, what: str, name: str, obj: Any, skip: bool, options: Any) -> bool | None:
    return True if isinstance(obj, types.GenericAlias) else None


def setup(app: Any) -> None:
    """Write the page of commands, and mend what autodoc takes for reStructuredText."""
    shutil.rmtree(HERE / "api", ignore_errors=True)  # pages of modules that are gone
    (HERE / "commands.md").write_text(manual.page(), encoding="utf-8")
    app.connect("autodoc-process-docstring", _escaped)
    app.connect("autodoc-skip-member", _skipped)
