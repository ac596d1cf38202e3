"""Pictures by the setting of ``--lift``, side by side: for docs/examples/which_setting.py."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from compensate import compensate
from compensate.aim import Aim
from compensate.plain import PlainRuler
from compensate.ruler import Ruler
from domesim import observe
from domesim.light import Light
from domesim.scene import Scene
from domesim.scene.screening import within_range

LIFTS = {
    "subtraction: lift 0": 0.0,
    "lift 0.5": 0.5,
    f"lift {Aim().lift:g}, the default": Aim().lift,
    "lift 2": 2.0,
}
_BRIGHTER = 4


def show_settings(pictures: Mapping[str, Light], scene: Scene) -> None:
    """Draw masters and what is seen of each by each setting; print what is lost, and the black.

    Black is the light of the darker half over the untouched one's: ColorVideoVDP cannot see it.

    Parameters
    ----------
    pictures
        Title -> (view, row, col, primary) a master; its first view is drawn.
    scene
        Where they are seen.
    """
    from matplotlib import pyplot as plt  # noqa: PLC0415 - takes a second

    heads = ("untouched", *(f"lift {lift:g}" for lift in LIFTS.values()))
    print(f"{'JOD lost, black':20}{''.join(f'{head:>12}' for head in heads)}")
    high = sum(0.6 + 2.1 * light.shape[1] / light.shape[2] for light in pictures.values())
    _, axes = plt.subplots(
        len(pictures), 2 + len(LIFTS), figsize=(13, high), layout="constrained", squeeze=False
    )
    for row, (name, light) in zip(axes, pictures.items(), strict=True):
        _draw_row(row, name, light, scene)
    plt.show()


def _draw_row(axes: Any, name: str, light: Light, scene: Scene) -> None:
    """One master and what is seen of it."""
    screen = scene.screen(*light.shape[1:3])
    wanted, _ = within_range(light, screen)
    ruler = Ruler(wanted, scene, screen)
    seen = {"untouched": observe(wanted, scene)}
    for title, lift in LIFTS.items():
        seen[title] = observe(compensate(wanted, scene, weighting=Aim(lift=lift)).light, scene)
    plain = PlainRuler(wanted, scene, screen)
    untouched = plain.black(seen["untouched"])
    told = {
        title: (ruler.lost(each), plain.black(each) / untouched) for title, each in seen.items()
    }
    print(f"{name:20}{''.join(f'{jod:7.2f}{black:5.2f}' for jod, black in told.values())}")
    for axis, (title, each) in zip(axes, {"master": wanted, **seen}.items(), strict=True):
        brighter = np.clip(_BRIGHTER * each[0], 0, 1) ** (1 / 2.2) * screen[..., None]
        axis.imshow(brighter)
        figures = "\nlost {:.2f} JOD, black {:.2f}".format(*told[title]) if title in told else ""
        axis.set(xticks=(), yticks=(), title=title + figures)
    axes[0].set_ylabel(name)
