"""A master on the screen: file -> Light -> what the audience sees -> file.

Off the screen (outside a domemaster's circle) a master's code values are never touched.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from domesim.advice import ADVICE
from domesim.errors import HopelessError, InputError
from domesim.frames import Master
from domesim.frames.halves import as_floats, as_halves
from domesim.frames.video import video_of
from domesim.light import Light, require_light, require_mask, transfer
from domesim.light.blocks import block_sums, by_blocks
from domesim.light.guarded import guarded
from domesim.light.planes import Columns, Index, Planes, empty_light, gathered
from domesim.light.rounding import ROUNDING
from domesim.light.strips import all_within, in_strips
from domesim.observation.projector import require_primaries
from domesim.scene import Scene, StereoScene

BRIGHTEST = 1e9
"""Projector white = 1: the sun's disc is 1e8 of an IMAX dome's. Beyond it is damage, and float32
overflows when light is summed and squared."""


def decoded(master: Master, scene: Scene) -> Light:
    """Light of a master, by its own encoding.

    Parameters
    ----------
    master
        One moment of a show.
    scene
        Where it is shown.

    Returns
    -------
    light
        (view, row, col, primary) float32, 1.0 = projector white; highlights may be above. A
        primary's plane lies in one piece: what goes through planes is twice as fast so.

    Raises
    ------
    InputError
        If it has other views than the scene, its transfer function or primaries are not known, or
        it is brighter than `BRIGHTEST`.
    """
    return gathered(decoder(master, scene), (len(master.frames), *master.frames[0].pixels.shape))


def averaged_on_screen(master: Master, scene: Scene, step: int) -> Light:
    """Averages the light of a master over blocks of pixels, without the light of all pixels.

    Parameters
    ----------
    master, scene
        As for `decoded`.
    step
        Pixels along a block's side.

    Returns
    -------
    light
        (view, row, col, primary) of blocks, clipped to 0..1; 0 where a block has no pixel on the
        screen.

    Raises
    ------
    InputError
        As for `decoded`.
    """
    light_of, (rows, cols, primaries) = decoder(master, scene), master.frames[0].pixels.shape
    screen = scene.screen(rows, cols)

    def sums(view: int, some: slice) -> NDArray[np.floating]:
        planes = [
            np.clip(plane, 0, 1) * screen[some] for plane in light_of(view, some, slice(0, cols))
        ]
        return np.stack([block_sums(plane, step) for plane in planes])

    count = block_sums(screen.astype(np.float32), step)
    total = by_blocks(sums, (len(master.frames), rows, cols, primaries), step, count)
    return np.moveaxis(total / np.maximum(count, 1), 1, -1)


def decoder(master: Master, scene: Scene) -> Planes:
    """Light of a master, part by part.

    Parameters
    ----------
    master, scene
        As for `decoded`.

    Returns
    -------
    light_of
        What tells it, float32, as `decoded` has it, in arrays of their own.

    Raises
    ------
    InputError
        As for `decoded`; what is too bright is found as it is asked for.
    """
    _require_views(master, scene)
    _require_whole_views(master, scene)
    require_primaries(master.colour.primaries)
    curve, primaries = _curve(master, scene), master.colour.primaries
    as_stored, cheap = _is_light(master, scene), is_cheap(master, scene)

    def light_of(view: int, rows: Index, cols: Index) -> Sequence[NDArray[np.floating]]:
        codes = master.frames[view].pixels[rows, cols]
        if cheap:
            return [as_floats(codes[..., p], sound=True) for p in range(codes.shape[-1])]
        if as_stored:
            planes = [as_floats(codes[..., p]) for p in range(codes.shape[-1])]
        else:
            # NumPy keeps such settings for each thread.
            with np.errstate(over="ignore", invalid="ignore"):
                floats = codes if codes.dtype == np.float32 else as_floats(codes)
                light = scene.projector.decode(floats, curve, primaries)
            planes = [np.ascontiguousarray(light[..., p]) for p in range(light.shape[-1])]
        brightest = max(float(plane.max(initial=0)) for plane in planes)
        if not brightest <= BRIGHTEST:
            raise InputError(
                f"{master.path}: wanted light up to {BRIGHTEST:g} (projector white is 1), got "
                f"{brightest:g}. Render it again, or clamp it ({ADVICE['clamp'].given()})."
            )
        return planes

    return light_of


def is_cheap(master: Master, scene: Scene) -> bool:
    """Says whether a master is decoded in less time than its light is fetched from memory.

    So are halves that are light of the projector's primaries already, from 0 to the largest half.

    Parameters
    ----------
    master, scene
        As for `decoded`.

    Returns
    -------
    cheap
        Whether it is.
    """
    halves = all(frame.brightest_half is not None for frame in master.frames)
    return halves and _is_light(master, scene)


def _is_light(master: Master, scene: Scene) -> bool:
    """Whether code values are light of the projector's primaries."""
    same = scene.projector.primaries == master.colour.primaries
    return same and isinstance(_curve(master, scene), transfer.Linear)


def _curve(master: Master, scene: Scene) -> transfer.Transfer:
    return transfer.named(master.colour.transfer, white=scene.projector.white)


def _require_views(master: Master, scene: Scene) -> None:
    if len(master.frames) == scene.views:
        return
    if scene.views == 1:
        raise HopelessError(
            f"{master.path}: wanted {scene.masters} for {scene.name}, got "
            f"{master.quilt or 'left and right'}. Do each alone, or choose a stereo scene."
        )
    if scene.views > 2 or master.quilt is not None:
        got = master.quilt or ("one picture" if len(master.frames) == 1 else "left and right")
        raise HopelessError(
            f"{master.path}: wanted {scene.masters} for {scene.name}, got {got}. A quilt's name "
            f"ends in its columns and rows of views, such as _qs8x6a0.75; or choose another scene."
        )
    eyes = master.frames[0].header.eyes
    packing = "" if eyes is None else f" {eyes.packing}, as it says itself"
    raise HopelessError(
        f"{master.path}: wanted left and right for {scene.name}, got one picture"
        f"{master.of_several}. Name both (--left L.####.exr --right R.####.exr), or say how they "
        f"are packed (--packing{packing})."
    )


def _require_whole_views(master: Master, scene: Scene) -> None:
    """Pixels are square: vision models would take a view of half the columns for a narrow screen.

    Only packed views are ever halved; any other may be narrower than the screen.
    """
    if master.packing not in ("side-by-side", "top-bottom") or not isinstance(scene, StereoScene):
        return
    rows, cols = master.frames[0].pixels.shape[:2]
    width, height = scene.size
    squeezed = (cols / rows) / (width / height)
    if 0.6 < squeezed < 1.6:
        return
    size, axis = ((2, 1), "width") if squeezed < 1 else ((1, 2), "height")
    way = ADVICE["stretch" if video_of(master.path) is None else "stretch a film"].given(
        cols=cols * size[0] * (2 if master.packing == "side-by-side" else 1),
        rows=rows * size[1] * (2 if master.packing == "top-bottom" else 1),
    )
    raise InputError(
        f"{master.path}: wanted views as wide as {scene.name}'s screen ({width / height:.3g} : 1), "
        f"got {cols} x {rows} px: views at half {axis}? Stretch the picture first ({way})."
    )


def encoded(
    master: Master,
    light: Light,
    scene: Scene,
    screen: NDArray[np.bool_],
    *,
    before: Planes | None = None,
    unclipped: Planes | None = None,
    spent: bool = False,
) -> tuple[Master, float]:
    """`master` with the picture on the screen replaced by `light`.

    It is encoded as `master` was, or as it is to become. No format holds all code values: light
    brighter than the white of an integer format (what the audience sees of a white master) or the
    largest half is clipped. So is what lies outside the file's gamut, negative in its primaries:
    floating formats could hold it, but `read_frame` and others' readers take it for damage.

    Parameters
    ----------
    master
        One moment of a show.
    light
        (view, row, col, primary), 1.0 = projector white.
    scene
        Where it is shown.
    screen
        (row, col) bool: pixels to replace.
    before
        What tells the light that `light` was made of, so that its grade is kept: only the
        difference is encoded, and where there is none, code values stay, to the bit.
    unclipped
        What tells the same light before it was clipped to what the projector shows: what was
        clipped is kept, too. None if nothing was.
    spent
        Whether the light may be overwritten: code values then take its memory, and no more.

    Returns
    -------
    master
        The new one.
    clipped
        Share of the screen's pixels that were clipped, 0..1.

    Raises
    ------
    InputError
        If it is no light, the screen is none, or values on it are no number.
    """
    projector, old = scene.projector, master.colour
    new = master.becomes or old
    require_primaries(new.primaries)
    read = transfer.named(old.transfer, white=projector.white)
    curve = transfer.named(new.transfer, white=projector.white)
    least, largest = 0.0, master.code_range[1]
    of_halves = largest == float(np.finfo(np.float16).max)
    pixels = _room_for_codes(light, of_halves=of_halves, spent=spent)
    columns, end, same = Columns(screen), light.shape[2], new.means_the_same_as(old)

    def encode(view: int, rows: slice) -> int:
        cols, full = columns.of(rows), columns.full(rows)
        shown = light[view, rows, cols]
        changed = None
        if before is not None:
            shown, changed = _graded(shown, before, unclipped, view, rows, cols)
        codes = projector.encode(shown, curve, new.primaries)
        each = [codes[..., p] for p in range(codes.shape[-1])]
        if changed is not None and same:  # linear codes may be `light` itself: nothing in place
            own = master.frames[view].pixels[rows, cols]
            each = [np.where(changed, code, own[..., p]) for p, code in enumerate(each)]
        # Half a code of 16 bit: rounding, not clipping
        count = beyond(each, screen[rows, cols], (least, largest), 0.5 / 65535)
        for p in range(pixels.shape[-1]):  # NumPy is slow along an axis of three
            within = np.clip(each[p], least, largest)
            within = as_halves(within) if of_halves and within.dtype == np.float32 else within
            pixels[view, rows, cols, p] = within
        for beside in (slice(0, full.start), slice(full.stop, end)):
            keep(view, rows, beside)
        return count

    def keep(view: int, rows: slice, cols: slice) -> None:
        """What lies off the screen in some columns."""
        around = master.frames[view].pixels[rows, cols]
        if not around.size:
            return
        if not same:
            shown = projector.decode(np.asarray(around, np.float32), read, old.primaries)
            around = projector.encode(shown, curve, new.primaries)
        if around.dtype != pixels.dtype or not of_halves:  # halves are within their range
            around = np.clip(around, least, largest)
        off = ~screen[rows, cols]
        for p in range(pixels.shape[-1]):
            np.copyto(pixels[view, rows, cols, p], around[..., p], where=off)

    clipped = sum(in_strips(encode, light.shape))
    result = master.encoded_as(new, pixels)
    return result, clipped / (len(light) * np.count_nonzero(screen))


def _room_for_codes(light: Light, *, of_halves: bool, spent: bool) -> NDArray[Any]:
    """Any codes of the shape of light; in its own memory if it is spent."""
    planes = np.moveaxis(light, -1, 1)
    if not (spent and planes.flags.c_contiguous and light.dtype == np.float32):
        return empty_light(light.shape, np.float16 if of_halves else np.float32)
    if of_halves:
        planes = planes.view(np.float16)[..., : light.shape[2]]  # a row's lie where the row began
    return np.moveaxis(planes, 1, -1)


def _graded(
    light: Light, before: Planes, unclipped: Planes | None, view: int, rows: slice, cols: slice
) -> tuple[Light, NDArray[np.bool_]]:
    """Light with what was clipped of the master, and (row, col) where it is not the master's."""
    own = before(view, rows, cols)
    apart = (np.abs(light[..., p] - plane) > ROUNDING for p, plane in enumerate(own))
    changed = reduce(np.logical_or, apart)
    if unclipped is None:
        return light, changed
    beyond = [more - plane for more, plane in zip(unclipped(view, rows, cols), own, strict=True)]
    return light + np.stack(beyond, axis=-1), changed


@guarded(light="view row col 3", areas="row col")
def mean_luminance(light: Light, scene: Scene, areas: NDArray[np.floating] | None = None) -> float:
    """Mean luminance over the screen's area and all views.

    Parameters
    ----------
    light
        (view, row, col, primary), 1.0 = projector white.
    scene
        Where it is shown.
    areas
        (row, col) areas of pixels, m²; the scene's if None.

    Returns
    -------
    luminance
        In cd/m².
    """
    if areas is None:
        areas = scene.pixel_areas(*light.shape[1:3])
    weights = scene.projector.luminance_weights.astype(light.dtype)
    sums = in_strips(
        lambda view, rows: float(np.sum(areas[rows] * (light[view, rows] @ weights))), light.shape
    )
    return sum(sums) / float(areas.sum() * len(light)) * scene.projector.white


def within_range(light: Light, screen: NDArray[np.bool_]) -> tuple[Light, float]:
    """`light` clipped to 0..1 on the screen.

    Highlights of a high-dynamic-range master and colours outside the projector's gamut cannot be
    shown at all; asking for them would only make the solver brighten their surroundings.

    Parameters
    ----------
    light
        (view, row, col, primary), 1.0 = projector white.
    screen
        (row, col) bool: pixels to clip.

    Returns
    -------
    light
        Unchanged if all was within.
    clipped
        Share of the screen's pixels that were clipped, 0..1.

    Raises
    ------
    InputError
        If it is no light, or has values on the screen that are no number.
    """
    require_light(light, who="within_range")
    require_mask(screen, who="within_range")
    if all_within(light, 0, 1):
        return light, 0.0
    within = np.array(light)

    def clip(view: int, rows: slice) -> int:
        part, on = within[view, rows], screen[rows]
        if np.isnan(part.min()) and np.isnan(part[on]).any():
            raise InputError("within_range takes light, got values that are no number")
        planes = [part[..., p] for p in range(part.shape[-1])]
        count = beyond(planes, on, (0, 1), ROUNDING)  # a white of 1 + 1e-7 is no highlight
        np.clip(part, 0, 1, out=part, where=on[..., None])
        return count

    count = sum(in_strips(clip, light.shape))
    return within, count / (len(light) * np.count_nonzero(screen))


def beyond(
    planes: Sequence[NDArray[np.floating]],
    on: NDArray[np.bool_],
    limits: tuple[float, float],
    slack: float,
) -> int:
    """Counts pixels of which a primary is out of limits.

    Parameters
    ----------
    planes
        (row, col) of each primary.
    on
        (row, col) pixels that count.
    limits
        The least and the largest value.
    slack
        By how much a value may exceed them.

    Returns
    -------
    count
        Of pixels.
    """
    least, largest = limits[0] - slack, limits[1] + slack
    if all(plane.min() >= least and plane.max() <= largest for plane in planes):
        return 0
    outside = reduce(np.logical_or, ((x < least) | (x > largest) for x in planes))
    return int(np.count_nonzero(outside & on))
