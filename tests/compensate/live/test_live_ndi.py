"""Pictures by NDI go through ``domesim live`` as through its pipe, in a network of their own."""

from __future__ import annotations

import importlib.util
import json
import shutil
import subprocess
from pathlib import Path
from typing import Any, NamedTuple

import ndi_pictures
import numpy as np
import pytest
from command_line import Run
from live_pictures import engine_for
from ndi_pictures import RATE, alone, lines_of, number_of, picture
from numpy.typing import NDArray

from compensate.live import ndi
from domesim.errors import InputError
from domesim.scene import Scene, load_scene

SIDE = 128


# Code values.


def test_codes_are_bt709s_in_limited_range():
    """Of ITU-R BT.709-6, 3.5, and 4.6: black, white, red and blue."""
    colours = np.array([[0, 0, 0], [255, 255, 255], [255, 0, 0], [0, 0, 255]])
    flat = np.repeat(np.repeat(colours[:, None], 4, 1), 2, 0).astype(np.uint16) * np.uint16(257)
    wanted = [[16, 128, 128], [235, 128, 128], [63, 102, 240], [32, 240, 118]]
    found = ndi.encoded(flat).reshape(8, 2, 4)[::2, 0][:, [1, 0, 2]]
    assert found.tolist() == wanted


@pytest.mark.parametrize("alpha", [False, True])
def test_what_is_decoded_is_encoded_again(alpha: bool) -> None:
    pixels = picture(5, 64, 96, alpha=alpha)
    codes = ndi.encoded(pixels)
    back = lines_of(codes, (64, 96), alpha=alpha)
    assert number_of(back) == 5
    if alpha:
        assert (back[..., 3] == pixels[..., 3]).all()
    again = ndi.encoded(back).astype(int)
    assert np.abs(again - codes)[1::2].max() <= 1


# A sender, ``domesim live`` and a receiver.


class Chain(NamedTuple):
    """What came through."""

    straight: NDArray[np.uint16]
    made: NDArray[np.uint16]
    later: NDArray[np.uint16]
    facts: dict[str, Any]


def chain(folder: Path, scene: str, cols: int, *, alpha: bool, count: int = 12) -> Chain:
    if importlib.util.find_spec("cyndilib") is None:
        pytest.skip("cyndilib (extra ndi) is not installed")
    if shutil.which("unshare") is None or shutil.which("ip") is None:
        pytest.skip("no unshare or ip on the PATH")
    tried = subprocess.run(
        ["unshare", "-rn", "ip", "link", "set", "lo", "up"], capture_output=True, check=False
    )
    if tried.returncode:
        pytest.skip(f"no network namespace can be made: {tried.stderr.decode()[:100]}")
    out = folder / "came.npz"
    kind = "alpha" if alpha else "opaque"
    done = alone(folder, ndi_pictures.__file__, scene, out, SIDE, cols, kind, 8, count)
    assert done.returncode == 0, done.stderr
    with np.load(out) as came:
        pictures = [came[name] for name in ("straight", "made", "later")]
        return Chain(*pictures, json.loads(str(came["facts"])))


@pytest.fixture(scope="module")
def dome(tmp_path_factory: pytest.TempPathFactory) -> Chain:
    return chain(tmp_path_factory.mktemp("dome"), "dome_planetarium", SIDE, alpha=True)


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Chain:
    folder = tmp_path_factory.mktemp("pair")
    return chain(folder, "stereo_cinema_silver", 2 * SIDE, alpha=False)


@pytest.mark.long
def test_the_sky_comes_back(dome: Chain) -> None:
    """What NDI's own compression changes."""
    for pixels in dome.straight:
        sent = picture(number_of(pixels), SIDE, SIDE, alpha=True)
        kept = lines_of(ndi.encoded(sent), (SIDE, SIDE), alpha=True)
        off = np.abs(pixels[..., 3].astype(int) - sent[..., 3]) / 257
        assert off.max() <= 1
        assert (off > 0).mean() < 0.02
        apart = np.abs(pixels[..., :3].astype(int) - kept[..., :3]) / 257
        assert np.quantile(apart, 0.999) <= 8
        assert apart.mean() < 1


def close(found: Chain, scene: Scene, *, alpha: bool) -> None:
    """Each picture is the pipe's of its own number, and of no other."""
    shape = found.made.shape[1:3]
    _, engine = engine_for(
        scene, SIDE, SIDE, "rgba64le" if alpha else "rgb48le", by="numpy", colour="bt709"
    )
    wanted = {
        number: np.array(engine(picture(number, *shape, alpha=alpha), number, 1.0))
        for number in range(1, 32)
    }

    def luma(codes: NDArray[Any]) -> NDArray[np.int_]:
        return ndi.encoded(codes)[1 : 2 * shape[0] * shape[1] : 2].astype(int)

    lumas = {number: luma(codes) for number, codes in wanted.items()}
    for pixels in found.made:
        number, own = number_of(pixels), luma(pixels)
        apart = {k: np.abs(own - each) for k, each in lumas.items()}
        assert min(apart, key=lambda k: apart[k].mean()) == number
        assert np.quantile(apart[number], 0.999) <= 8
        assert apart[number].mean() < 1
        if alpha:
            assert np.abs(pixels[..., 3].astype(int) - wanted[number][..., 3]).max() <= 257


@pytest.mark.long
def test_a_dome_is_what_the_pipe_makes(dome: Chain) -> None:
    close(dome, load_scene("dome_planetarium"), alpha=True)


@pytest.mark.long
def test_a_pair_is_what_the_pipe_makes(pair: Chain) -> None:
    close(pair, load_scene("stereo_cinema_silver"), alpha=False)


@pytest.mark.long
def test_rate_and_alpha_are_kept(dome: Chain, pair: Chain) -> None:
    for found, alpha in ((dome, True), (pair, False)):
        assert found.facts["rate"] == found.facts["made_rate"] == float(RATE)
        assert found.facts["alpha"] is found.facts["made_alpha"] is alpha


@pytest.mark.long
def test_an_end_is_told(dome: Chain) -> None:
    assert dome.facts["code"] == 0
    figures = json.loads(dome.facts["said"].partition("ready\n")[2])
    assert figures["frames"] >= len(dome.made)
    assert figures["latency_frames"] < 3


@pytest.mark.long
def test_a_source_that_goes_away_is_waited_for(dome: Chain) -> None:
    assert len(dome.later) == 3
    assert "NDI source show has gone; it is waited for" in dome.facts["told"]
    for pixels in dome.later:
        assert 0 < number_of(pixels) < 32


# What is refused.


def test_odd_sides_are_refused() -> None:
    with pytest.raises(InputError, match="even sides, got 63 x 64"):
        ndi.require_even(64, 63)


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"rows": 48}, "as before, got 64 x 48"),
        ({"fourcc": int.from_bytes(b"UYVA", "little")}, "without alpha, as before, got"),
        ({"fields": 0}, "got fields"),
        ({"fourcc": int.from_bytes(b"NV12", "little")}, "another layout"),
    ],
)
def test_pictures_that_change_are_refused(changes: dict[str, int], word: str) -> None:
    receiver = object.__new__(ndi.Receiver)  # there may be no library
    receiver._name, receiver.shape, receiver.alpha, receiver.rate = "show", (0, 0), False, 0
    kind = int.from_bytes(b"UYVY", "little")
    video = ndi._Video(
        rows=64, cols=64, fourcc=kind, fields=1, rate_numerator=30, rate_denominator=1
    )
    receiver._look(video)
    for name, value in changes.items():
        setattr(video, name, value)
    with pytest.raises(InputError, match=word):
        receiver._look(video)


def test_both_ways_are_named(run: Run) -> None:
    run("live", "--scene", "dome_imax", "--ndi-in", "show").is_refused("--ndi-out", "name both")


def test_without_the_library_the_extra_is_named(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    ndi._runtime.cache_clear()
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    both = ("--ndi-in", "show", "--ndi-out", "dome")
    run("live", "--scene", "dome_imax", *both).is_refused("pip install 'domesim[ndi]'")
    ndi._runtime.cache_clear()
