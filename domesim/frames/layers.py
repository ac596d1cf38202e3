"""Which channels, and which part of a file, are its picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from domesim.advice import ADVICE
from domesim.errors import InputError
from domesim.frames.messages import one_line


def find_grey(channels: Sequence[str]) -> tuple[int, int, int] | None:
    """Which channel is Y, for R, G and B; None if Y is not the only picture that there is."""
    upper = [name.upper() for name in channels]
    # X: CIE XYZ. RY, BY: chroma, which OpenEXR keeps at half the size.
    if upper.count("Y") != 1 or not {"R", "G", "B", "X", "RY", "BY"}.isdisjoint(upper):
        return None
    return (upper.index("Y"),) * 3


def find_layer(channels: tuple[str, ...]) -> tuple[tuple[int, int, int] | None, str]:
    """Which channels are R, G, B of the only layer, or of that which combines others; or X, Y, Z.

    And the layer's name; None and "" where R, G, B stand alone, or it is open which layer is meant.
    """
    upper = [channel.upper() for channel in channels]
    if not {"R", "G", "B"}.isdisjoint(upper):
        return None, ""
    if all(upper.count(axis) == 1 for axis in "XYZ"):
        return (upper.index("X"), upper.index("Y"), upper.index("Z")), ""
    layers = [layer for layer in layers_of(channels) if layer]
    combined = [layer for layer in layers if layer.rpartition(".")[2].lower() == "combined"]
    chosen = layers if len(layers) == 1 else combined
    if len(chosen) != 1:
        return None, ""
    return _ends(channels, chosen[0]), chosen[0]


def _ends(channels: Sequence[str], layer: str) -> tuple[int, int, int]:
    """Which channels are R, G, B of a layer."""
    upper = [channel.upper() for channel in channels]
    red, green, blue = (upper.index(f"{layer}.{end}".upper()) for end in "RGB")
    return red, green, blue


def layer_of(path: Path, channels: tuple[str, ...], layer: str) -> tuple[int, int, int]:
    """Which channels are R, G, B of a layer that was asked for."""
    layers = layers_of(channels)
    if layer not in layers:
        raise InputError(
            f"{path}: wanted layer {one_line(layer)!r} of R, G, B, got "
            f"{listed(layers) or 'no layers'}. Choose one of these, or leave --layer out."
        )
    return _ends(channels, layer)


def refuse_layer(path: Path, layer: str | None, kind: str) -> None:
    """Refuse to look for a layer where there are none."""
    if layer is not None:
        raise InputError(
            f"{path}: wanted layer {one_line(layer)!r}, got {kind}, which has none. Leave --layer "
            "out."
        )


def find_rgb(path: Path, model: str, channels: tuple[str, ...], view: str) -> tuple[int, int, int]:
    """Which channels are R, G, B."""
    # OpenImageIO turns others into an RGB of its own making.
    if model not in ("", "RGB", "YCbCr", "palette"):
        raise InputError(f"{path}: wanted channels R, G, B, got {model}. Convert it to RGB.")
    indices = [[k for k, name in enumerate(channels) if name.lower() == wanted] for wanted in "rgb"]
    if all(len(matches) == 1 for matches in indices):
        red, green, blue = (matches[0] for matches in indices)
        return red, green, blue
    grey = next((name for name in channels if name.upper() in ("Y", "L", "I")), None)
    layers = [layer for layer in layers_of(channels) if layer]
    way = ADVICE["grey"].given(grey=grey) if grey and len(channels) < 3 else ""
    if layers:
        way = (
            f"choose one of layers {listed(layers)}: --layer {one_line(layers[0])}, or "
            f"{ADVICE['layer'].given(layer=layers[0])}"
        )
    names = listed(channels)
    if view:
        raise InputError(
            f"{path}: wanted one each of channels R, G, B, or Y alone, in view {view}, got "
            f"{names or 'none'}. Name them so where it was made."
        )
    raise InputError(
        f"{path}: wanted one each of channels R, G, B, got {names}. "
        f"Convert it to RGB first{f' ({way})' if way else ' where it was made'}."
    )


def layers_of(channels: Sequence[str]) -> list[str]:
    """Names of layers that have R, G and B: ``beauty`` of ``beauty.R``."""
    ends = (
        {name.rpartition(".")[0] for name in channels if name.upper().endswith(end)}
        for end in (".R", ".G", ".B")
    )
    return sorted(set.intersection(*ends))


def listed(names: Sequence[str]) -> str:
    """The first of `names`, for a message."""
    return one_line(", ".join(names[:8])) + (", ..." if len(names) > 8 else "")


def views_of(specs: Sequence[Any]) -> tuple[str, ...]:
    """The view of each part, as it names it; "" of none."""
    return tuple(spec.get_string_attribute("view") for spec in specs)


def left_and_right(path: Path, views: Sequence[str]) -> tuple[int, int]:
    """Which of the views is left, and which is right; refuses others."""
    folded = [view.casefold() for view in views]
    if sorted(folded) != ["left", "right"]:
        raise InputError(
            f"{path}: wanted views left and right, got {listed(views)}. "
            "Write these two alone, under these names."
        )
    return folded.index("left"), folded.index("right")


def picture_part(path: Path, specs: Sequence[Any], layer: str | None) -> int:
    """Which part has the picture, or the `layer`, of a file that is one view."""
    if len(specs) == 1:
        return 0
    names = [spec.get_string_attribute("oiio:subimagename") for spec in specs]
    layers = [layers_of(spec.channelnames) for spec in specs]
    if layer is None:
        whole = [k for k, spec in enumerate(specs) if _has_picture(spec.channelnames)]
        found = whole or [k for k, each in enumerate(layers) if each]
    else:
        found = [k for k, each in enumerate(names) if layer in (each, str(k))]
        found = found or [k for k, each in enumerate(layers) if layer in each]
    views = {view.casefold() for view in views_of(specs)} - {""}
    if len(found) == 1 and len(views) < 2:
        return found[0]
    known = [name or str(k) for k, name in enumerate(names)]
    wanted = "one picture" if layer is None else f"one part or layer {one_line(layer)!r}"
    number = found[0] if found else 0
    way = f"--layer {one_line(known[number])}, or {ADVICE['one part'].given(number=number)}"
    if len(views) > 1:
        way = f"{ADVICE['one part'].given(number=number)}, or give this file alone"
    raise InputError(
        f"{path}: wanted {wanted}, got a file of several parts ({listed(known)}). Choose one of "
        f"them ({way})."
    )


def picture_of_side(path: Path, specs: Sequence[Any], side: str, layer: str | None) -> int:
    """Which part has the picture, or the `layer`, of one of two views."""
    of_side = [index for index, view in enumerate(views_of(specs)) if view.casefold() == side]
    pictures = [index for index in of_side if _has_picture(specs[index].channelnames)]
    wanted = "channels R, G, B, or Y alone"
    if layer is not None:
        pictures = [index for index in of_side if layer in layers_of(specs[index].channelnames)]
        wanted = f"layer {one_line(layer)!r}"
    if len(pictures) != 1:
        got = "; ".join(
            f"{one_line(specs[index].get_string_attribute('oiio:subimagename'))} with "
            f"{listed(specs[index].channelnames)}"
            for index in of_side[:4]
        )
        raise InputError(
            f"{path}: wanted one part of view {side} with {wanted}, "
            f"got {got}. Keep one such part for each view."
        )
    return pictures[0]


def _has_picture(channels: Sequence[str]) -> bool:
    names = {name.upper() for name in channels}
    return {"R", "G", "B"} <= names or find_grey(channels) is not None
