"""The pictures of ``docs/theatres.md``: each theatre from outside, from a seat, and its domemaster.

``python -m validation.gallery docs/theatres`` renders them anew (twenty minutes on two cores).
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from domesim.rendering import render
from domesim.scene import load_scene, scene_names

SIZES = {"cutaway": 720, "domemaster": 480, "seat:centre": 720}


def main(folder: Path) -> None:
    """Render every view of every scene into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    for scene in scene_names():
        for view, size in SIZES.items():
            target = folder / f"{scene}-{view.split(':')[0]}.png"
            if view.startswith("seat:") and not load_scene(scene).theatre.viewpoints:
                continue
            if view == "cutaway":
                render(scene, target, view=view, size=size)
                continue
            with tempfile.TemporaryDirectory() as temporary:
                layered = Path(temporary) / "view.exr"
                render(scene, layered, view=view, size=size)
                target.write_bytes(layered.with_suffix(".png").read_bytes())


if __name__ == "__main__":
    main(Path(sys.argv[1]))
