"""Diagrams and pictures of findings: SVG by Matplotlib, JPEG in display light."""

from __future__ import annotations

import base64
import csv
import io
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from domesim.light import Light
from domesim.light.transfer import named
from domesim.scene import Scene
from validation.experiment import Panel, Pictures, Plot

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
"""Okabe and Ito's, which colour-blind readers can tell apart."""

_STYLE: Any = {
    "axes.prop_cycle": f"cycler('color', {list(COLOURS)})",
    "font.size": 9.5,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#e4e4e4",
    "legend.frameon": False,
    "lines.markersize": 4.5,
    "svg.hashsalt": "domesim",
}


def plot(
    caption: str, alt: str, draw: Callable[[Any], None], size: tuple[float, float] = (5.6, 3.5)
) -> Plot:
    """A diagram that `draw` puts on Matplotlib axes; size in inches."""
    # Half a second to import, and commands that draw nothing import this module's users
    import matplotlib as mpl  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415

    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=size, layout="constrained")
        draw(figure.add_subplot())
        data = _drawn(figure.axes[0])
        svg, pdf = io.StringIO(), io.BytesIO()
        figure.savefig(svg, format="svg", metadata={"Date": None}, transparent=True)
        figure.savefig(pdf, format="pdf", metadata={"CreationDate": None}, transparent=True)
    return Plot(caption=caption, alt=alt, svg=svg.getvalue(), pdf=pdf.getvalue(), data=data)


def _drawn(axes: Any) -> str:
    """What lines, points and bars of axes show, in CSV: series, x, y."""
    from matplotlib.collections import PathCollection  # noqa: PLC0415

    series = [(line.get_label(), line.get_xydata()) for line in axes.lines]
    series += [
        (points.get_label(), points.get_offsets())
        for points in axes.collections
        if isinstance(points, PathCollection)  # others are areas and error bars
    ]
    for bars in axes.containers:
        if getattr(bars, "orientation", None) is None:
            continue
        upright = bars.orientation == "vertical"
        middles = [bar.get_center()[0 if upright else 1] for bar in bars]
        lengths = list(bars.datavalues)
        pairs = zip(middles, lengths, strict=True)
        series.append((bars.get_label(), [p if upright else p[::-1] for p in pairs]))
    memory = io.StringIO()
    rows = csv.writer(memory, lineterminator="\n")
    rows.writerow(("series", axes.get_xlabel() or "x", axes.get_ylabel() or "y"))
    for number, (label, points) in enumerate(series, 1):
        name = str(number) if str(label).startswith("_") else label
        rows.writerows((name, f"{x:.9g}", f"{y:.9g}") for x, y in np.asarray(points, np.float64))
    return memory.getvalue()


def legend_beside(axes: Any) -> None:
    """Put a diagram's legend to its right, where long names cover nothing."""
    axes.legend(fontsize=7.5, loc="center left", bbox_to_anchor=(1.0, 0.5))


def pictures(
    caption: str, lights: Mapping[str, Light], scene: Scene, *, brightest: float = 1.0
) -> Pictures:
    """Domemasters side by side.

    Parameters
    ----------
    caption
        Says how bright they are shown, too.
    lights
        Title -> (1, row, col, primary) light.
    scene
        The theatre, whose projector's primaries they are in.
    brightest
        Light that is shown as the display's white.
    """
    return Pictures(
        caption=caption,
        panels=tuple(
            panel(title, light, scene, what="Domemaster", brightest=brightest)
            for title, light in lights.items()
        ),
    )


def panel(title: str, light: Light, scene: Scene, *, what: str, brightest: float = 1.0) -> Panel:
    """One picture.

    Parameters
    ----------
    title
        Title of the picture.
    light, scene, brightest
        As for `pictures`.
    what
        Kind of picture, for those who cannot see it.
    """
    data = _jpeg(_coded(light, scene, brightest))
    return Panel(title=title, alt=f"{what}: {title}", data=data)


def _coded(light: Light, scene: Scene, brightest: float) -> NDArray[np.uint8]:
    """(row, col, 3) sRGB codes; white outside the screen, as the page is."""
    shown = np.clip(scene.projector.to_display(light)[0] / brightest, 0, 1).astype(np.float32)
    codes = np.round(255 * named("srgb", white=1.0).encode(shown)).astype(np.uint8)
    codes[~scene.screen(*codes.shape[:2])] = 255
    return np.asarray(codes)


def _jpeg(codes: NDArray[np.uint8]) -> str:
    from matplotlib.image import imsave  # noqa: PLC0415

    memory = io.BytesIO()
    imsave(memory, codes, format="jpg", pil_kwargs={"quality": 90})
    return "data:image/jpeg;base64," + base64.b64encode(memory.getvalue()).decode()
