"""The pictures of ``docs/theatres.md``: each theatre from outside, from a seat, and its domemaster.

``make gallery`` renders them anew (half an hour on two cores). Scenes named as further arguments
are the only ones to be rendered.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import OpenImageIO as oiio  # noqa: N813 (its own documentation calls it so)

from domesim.commands.render import render
from domesim.scene import load_dome, scene_names

SIZES = {"cutaway": 720, "domemaster": 480, "seat:centre": 720}


def main(folder: Path, scenes: list[str]) -> None:
    """Render every view of scenes into `folder`, as JPEG."""
    folder.mkdir(parents=True, exist_ok=True)
    for scene in scenes:
        for view, size in SIZES.items():
            if view.startswith("seat:") and not load_dome(scene).theatre.viewpoints:
                continue
            with tempfile.TemporaryDirectory() as temporary:
                suffix = ".png" if view == "cutaway" else ".exr"
                rendered = Path(temporary) / f"view{suffix}"
                render(scene, rendered, view=view, size=size, error=0.1)
                to_jpeg(rendered.with_suffix(".png"), folder / f"{scene}-{view.split(':')[0]}.jpg")


def to_jpeg(source: Path, target: Path) -> None:
    """Convert a picture: a fifth of the bytes, and nobody measures these."""
    picture = oiio.ImageBuf(str(source))
    picture.specmod().attribute("Compression", "jpeg:88")
    if not picture.write(str(target)):
        raise OSError(picture.geterror())


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:] or list(scene_names()))
