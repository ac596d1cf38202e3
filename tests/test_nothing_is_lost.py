"""Commands that write: nobody else's files are replaced, whatever they are called."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
import typer
from command_line import Outcome
from rigs import Rig

from domesim.commands import build
from domesim.frames import ColourTag, Frame, write_frame
from domesim.host.writing import LIST
from domesim.measure.dome.camera import Camera
from domesim.measure.patterns import Codes
from domesim.measure.patterns.dome import SHIFTED, dome_patterns
from domesim.scene import load_dome
from testing.laboratory import Faults, patterns_for, photographed

SRGB, LINEAR = ColourTag("srgb", "BT.709", "test"), ColourTag("linear", "BT.709", "test")
EYES = ("--left", "L.png", "--right", "R.png")
STEREO = ("--scene", "stereo_polarised_paper")
DOME = ("--scene", "dome_hemisphere")
STUDY = ("--methods", "none,subtractive", "--side-by-side", "--viewers", "2", "--sittings", "1")
PATH_TRACED = ("--size", "16", "--samples", "2", "--error", "10")

QUICK = {
    "compensate": ("in.png", *DOME, "--out", "to"),
    "compensate of a sequence": ("in.#.png", *DOME, "--format", "mkv", "--out", "to"),
    "observe": (*EYES, *STEREO, "--out", "to"),
    "domemaster": ("around.png", "--from", "equirectangular", "--out", "to"),
    "predict": ("in.#.png", *DOME, "--workers", "0", "--out", "to"),
    "compare": ("in.png", *DOME, "--out", "to/page.html"),
    "preview": ("in.png", *DOME, "--out", "to/film.mp4"),
    "shader": (*DOME, "--size", "64x64", "--out", "to/a.glsl"),
    "measure crosstalk": ("rig.csv", "--out", "to/rig.toml"),
    "measure grey-to-grey": ("grey.csv", "--out", "to/panel.toml"),
    "scene show": ("dome_hemisphere", "--no-cutaway", "--out", "to/page.html"),
    "scene check": ("dome_hemisphere", "--out", "to/check.png"),
    "scene export": ("dome_dark", "--size", "64x40", "--out", "to/dome.mpcdi"),
    "scene import": ("in.mpcdi", "--out", "to/mine.toml"),
    "scene new": ("to/new", "--radius", "5"),
    "bench": ("--quick", "--problems", "dome", "--sizes", "16", "--solvers", "admm", "--out", "to"),
}
"""Arguments of each command that writes; files of their own are made by `inputs`."""

SLOW = {
    "demo": ("--out", "to"),
    "master": ("--size", "16", "--samples", "1", "--out", "to"),
    "render": ("dome_hemisphere", "--master", "in.png", *PATH_TRACED, "--out", "to/a.exr"),
    "tabulate": ("dome_hemisphere", "--walks", "1", "--no-check", "--out", "to/a.npz"),
    "measure patterns": ("--stereo", "--size", "64x64", "--out", "to"),
    "measure dome": ("survey.toml", "--residual", "to/a.png", "--out", "to/theatre.toml"),
    "measure reflected": ("survey.toml", "--out", "to/map.csv"),
    "scene advise": ("dome_hemisphere", "in.png", "--out", "to/advice.svg"),
    "study new": (*EYES, *STEREO, *STUDY, "--out", "to"),
    "study analyse": ("study",),
    "validate": ("--quick", "--only", "closed_form", "--out", "to"),
}

NOWHERE = {"doctor", "live", "report-card", "measure response", "study power"}
"""Commands that write no files."""

OWN = ("job", "pictures", "server")
"""Folders that commands make for themselves."""

ANSWERING = {"study play", "measure by-eye"}
"""Commands that write what others send them: test_audience_page.py, test_by_eye.py."""


def test_all_commands_are_tried() -> None:
    """A new command is in one of these lists, or this test says so."""

    def names(command: object, above: tuple[str, ...] = ()) -> Iterator[str]:
        for name, each in getattr(command, "commands", {}).items():
            yield from names(each, (*above, name))
        if not hasattr(command, "commands"):
            yield " ".join(above)

    tried = {name.partition(" of ")[0] for name in (*QUICK, *SLOW)}
    assert tried | NOWHERE | ANSWERING == set(names(typer.main.get_command(build())))


@pytest.fixture
def inputs(tmp_path: Path, run: Callable[..., Outcome], monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with what commands read."""
    pixels = np.full((32, 32, 3), 0.2, np.float32)
    pixels[10:14, 10:14] = 0.9
    for name in ("in.png", "in.1.png", "in.2.png"):
        write_frame(Frame(pixels, tmp_path / name, SRGB, 8, floating=False), tmp_path / name)
    wide = np.tile(pixels, (1, 2, 1))
    write_frame(
        Frame(wide, tmp_path / "around.png", SRGB, 8, floating=False), tmp_path / "around.png"
    )
    for name, at in (("L.png", 3), ("R.png", 7)):
        pixels = np.full((12, 20, 3), 0.1, np.float32)
        pixels[:, at : at + 4] = 0.8
        write_frame(Frame(pixels, tmp_path / name, SRGB, 8, floating=False), tmp_path / name)
    (tmp_path / "rig.csv").write_text(Rig(ramps=False).csv())
    grey = [
        f"{eye},{own},{other},{0.1 + 40 * (own**2 + 0.02 * other**2)}"
        for eye in ("left", "right")
        for own in (0, 0.5, 1)
        for other in (0, 0.5, 1)
    ]
    (tmp_path / "grey.csv").write_text("\n".join(["filter,own_level,other_level,Y", *grey]))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def made_for(command: str, run: Callable[..., Outcome]) -> None:
    """Make what only one command reads."""
    if command == "scene import":
        assert run("scene", "export", *QUICK["scene export"][:-1], "in.mpcdi").code == 0
    if command == "study analyse":
        said = run("study", "new", *EYES, *STEREO, *STUDY, "--out", "study", "--json")
        study, trials = said.figures()["study"], said.figures()["trials"]
        for viewer in (1, 2):
            answers = ", ".join(f'{{"trial": {k}, "choice": 1}}' for k in range(trials))
            Path(f"study/answers/viewer-{viewer:03}.json").write_text(
                f'{{"study": "{study}", "viewer": {viewer}, "answers": [{answers}]}}'
            )
    dome = load_dome("dome_hemisphere").theatre.dome
    if command == "measure dome":
        names = ("black", "white", "front", "right", "zenith", "rim", "sectors")
        survey(names, patterns_for(dome, 64))
    if command == "measure reflected":
        boards = [
            each
            for each in dome_patterns(dome, Codes(16, floating=False, transfer="linear"), 4)
            if each.name.startswith(("black", SHIFTED))
        ]
        light = [np.asarray(each.codes(192, 192)[0], np.float64) for each in boards]
        survey([each.name for each in boards], np.stack(light))


def survey(names: Sequence[str], patterns: np.ndarray) -> None:
    """Photographs of a theatre, and their survey."""
    here = Path()
    theatre = load_dome("dome_hemisphere").theatre
    camera = Camera((0.1, -0.5, -0.3), (0.0, 1.5, 1.0), np.radians(220.0))
    taken = photographed(theatre, camera, patterns, Faults(), walks=24, seed=4)
    for name, pattern, light in zip(names, patterns, taken.light, strict=True):
        for path, pixels in ((f"pattern_{name}.exr", pattern), (f"{name}.exr", light)):
            frame = Frame(pixels.astype(np.float32), here / path, LINEAR, 32, floating=True)
            write_frame(frame, here / path)
    shots = "".join(
        f'\n[[photographs]]\nfile = "{name}.exr"\npattern = "pattern_{name}.exr"\n'
        for name in names
    )
    place = "position_m = [0.1, -0.5, -0.3]\nlook_at_m = [0.0, 1.5, 1.0]\nfield_deg = 220.0\n"
    text = f'theatre = "dome_hemisphere"\n\n[camera]\n{place}{shots}'
    Path("survey.toml").write_text(text)


def digests(folder: Path) -> dict[str, str]:
    """Relative path -> SHA-256 of each file, "" of each folder, and where each link leads."""

    def state(path: Path) -> str:
        if path.is_symlink():
            return f"-> {path.readlink()}"
        return "" if path.is_dir() else hashlib.sha256(path.read_bytes()).hexdigest()

    return {str(path.relative_to(folder)): state(path) for path in sorted(folder.rglob("*"))}


def file(path: Path) -> None:
    path.write_text(f"{path.name} of somebody else")


def folder(path: Path) -> None:
    path.mkdir()
    file(path / "theirs")


def link(path: Path) -> None:
    path.symlink_to(Path("elsewhere").absolute() / "theirs")


def link_to_nothing(path: Path) -> None:
    path.symlink_to("nothing")


WAYS = (file, folder, link, link_to_nothing)
"""What somebody else may have in a file's place."""


def removed(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


@pytest.mark.parametrize(
    "command",
    [*QUICK, *(pytest.param(name, marks=pytest.mark.long) for name in SLOW)],
)
def test_files_of_somebody_else_stay(
    command: str, inputs: Path, run: Callable[..., Outcome]
) -> None:
    """Files and folders of every name that a command uses are refused before it writes anything."""
    words = [*command.partition(" of ")[0].split(), *(QUICK | SLOW)[command]]
    made_for(command, run)
    before = digests(inputs)
    assert run(*words).code == 0
    made = {name: digest for name, digest in digests(inputs).items() if name not in before}
    assert made
    if command != "scene new":  # whose figures are edited
        assert run(*words).code == 0  # over its own
    for name in sorted(made, reverse=True):
        removed(inputs / name)

    files = [name for name, digest in made.items() if digest and Path(name).name != LIST]
    assert files
    lists = [name for name in made if Path(name).name == LIST]
    own = [str(Path(name).parent) for name in lists if (inputs / name).parent.name in OWN]
    tried = [(files, way) for way in WAYS]
    tried += [([name], WAYS[number % len(WAYS)]) for number, name in enumerate(files)]
    tried += [([name], file) for name in lists]
    tried += [([name], way) for name in own for way in WAYS]
    folder(inputs / "elsewhere")
    for names, way in tried:
        for name in names:
            path = inputs / name
            path.parent.mkdir(parents=True, exist_ok=True)
            way(path)
        theirs = digests(inputs)
        refused = run(*words)
        refused.is_refused()
        assert digests(inputs) == theirs, (names, way)
        for name in sorted(set(theirs) - set(before), reverse=True):
            if not name.startswith("elsewhere"):
                removed(inputs / name)
