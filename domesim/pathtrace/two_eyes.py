"""What both eyes see in a 3D dome, from layers of each view's light traced by itself.

Of what makes the views differ, each reflection keeps a share k, so that the n-th reflection shows
k^n of it (`domesim.observation.dome_pair`); then a share of all leaks to the other eye. Reflections
off other surfaces than the screen count as such: where k is neither 0 nor 1, that is approximate.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Layers: TypeAlias = Mapping[str, NDArray[Any]]
"""(row, col, primary) pictures by name, as ``domesim render`` writes them."""

_BOUNCE = "bounce"


def seen_by_eyes(
    views: tuple[Layers, Layers], kept: float, leaks: NDArray[np.floating[Any]]
) -> list[dict[str, NDArray[Any]]]:
    """Layers of what the left eye sees, and the right one.

    Parameters
    ----------
    views
        Layers of the left view's light and of the right one's; with all bounces unless `kept` is 0
        or 1. "ambient" is what either eye sees; errors of "variance" add up, as if they were one.
    kept
        k.
    leaks
        (view, primary, primary) crosstalk of each eye.
    """
    mixed = [_kept(views[v], views[1 - v], kept) for v in range(2)]
    result = []
    for v in range(2):
        own, other, leak = mixed[v], mixed[1 - v], leaks[v].T
        layers = {name: own[name] + other[name] @ leak for name in own if name != "variance"}
        errors = np.sqrt(own["variance"]) + np.sqrt(other["variance"]) @ np.abs(leak)
        layers["variance"] = errors**2
        if (ambient := views[v].get("ambient")) is not None:
            layers["ambient"] = np.array(ambient)
            layers[""] = layers[""] + ambient
        result.append({name: np.asarray(layer, np.float32) for name, layer in layers.items()})
    return result


def _kept(own: Layers, other: Layers, kept: float) -> dict[str, NDArray[Any]]:
    """An eye's layers where nothing leaks but what reflections do not keep apart."""
    bounces = {name: int(name.removeprefix(_BOUNCE)) for name in own if name.startswith(_BOUNCE)}
    kept_layers = {
        name: (1 + kept**n) / 2 * own[name] + (1 - kept**n) / 2 * other[name]
        for name, n in bounces.items()
    }
    if bounces:
        indirect = sum(kept_layers[name] - own[name] for name in bounces) + own["indirect"]
    else:
        indirect = (1 + kept) / 2 * own["indirect"] + (1 - kept) / 2 * other["indirect"]
    return {
        "": own["direct"] + indirect,
        "direct": own["direct"],
        "indirect": indirect,
        "variance": own["variance"]
        if kept == 1
        else (np.sqrt(own["variance"]) + np.sqrt(other["variance"])) ** 2,
        **kept_layers,
    }
