"""What judges said, kept by what they saw: code that shows the same light need not be judged anew.

Two hours of a full run are judges. Steps are measured anew when any module changes that they rest
on, but a figure of a judge rests on two pictures, the scene, the judge's package, and a few
modules of ours alone.
"""

from __future__ import annotations

import hashlib
import pickle
from functools import cache
from importlib import metadata
from pathlib import Path

from pydantic import TypeAdapter, ValidationError
from pydantic_core import to_json

from domesim.host.writing import write_whole
from domesim.light import Light
from domesim.observation import projector
from domesim.scene import Scene
from validation import judges, panel

_PACKAGES = ("cvvdp", "pyfvvdp", "piq", "torch", "flip-evaluator", "colour-science")
_FIGURE = TypeAdapter(float)


def heard(
    judge: panel.Judge, reference: Light, test: Light, scene: Scene, store: Path | None
) -> float:
    """Asks a judge, or reads what it said of the same light.

    Parameters
    ----------
    judge
        Who.
    reference, test
        (view, row, col, primary), 1 = projector white.
    scene
        Where.
    store
        Folder of figures; None asks the judge.

    Returns
    -------
    figure
        The judge's.

    Raises
    ------
    Missing
        If its package is not installed.
    """
    if store is None:
        return judge.judge(reference, test, scene)
    asked = hashlib.sha256(_ears())
    for part in (judge.name.encode(), pickle.dumps(scene), reference.tobytes(), test.tobytes()):
        asked.update(hashlib.sha256(part).digest())
    path = store / f"{asked.hexdigest()[:32]}.json"
    try:
        return _FIGURE.validate_json(path.read_bytes())
    except (OSError, ValidationError):
        figure = judge.judge(reference, test, scene)
    store.mkdir(parents=True, exist_ok=True)
    write_whole(path, to_json(figure, inf_nan_mode="constants"))  # JSON has no infinities
    return figure


@cache
def _ears() -> bytes:
    """What figures rest on besides the pictures and the scene."""
    ours = [Path(str(module.__file__)).read_bytes() for module in (judges, panel, projector)]
    theirs = [f"{each} {_version(each)}\n".encode() for each in _PACKAGES]
    return b"".join([*ours, *theirs])


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"
