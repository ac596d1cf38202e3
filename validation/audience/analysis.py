"""What a study's answers show: figures for a program, and a page with diagrams."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from validation.audience.files import Answers, Study
from validation.audience.folder import environment
from validation.audience.inference import Audience, audience
from validation.audience.viewers import Viewer, by_master, counts, viewer
from validation.drawing import COLOURS, plot
from validation.experiment import Plot
from validation.study import Scale

BRIGHT = 0.1
"""Share by which the white that was read may be off."""


@final
@dataclass(frozen=True)
class Analysis:
    """What a study shows.

    Attributes
    ----------
    study
        The study.
    everybody
        All viewers.
    without
        The viewers of whom nothing is told; None if these are all, or fewer than two.
    viewers
        How each one answered.
    masters
        Name of a master -> (method, method) choices of all viewers.
    displays
        What is to be said of the displays.
    """

    study: Study
    everybody: Audience
    without: Audience | None
    viewers: tuple[Viewer, ...]
    masters: Mapping[str, NDArray[np.int64]]
    displays: tuple[str, ...]

    def figures(self) -> dict[str, Any]:
        """For a program."""
        return {
            "study": self.study.digest,
            "scene": self.study.scene,
            "question": self.study.question,
            **_told(self.everybody),
            "without_told_viewers": None if self.without is None else _told(self.without),
            "viewers": [asdict(one) for one in self.viewers],
            "masters": {name: wins.tolist() for name, wins in self.masters.items()},
            "displays": list(self.displays),
        }

    def page(self) -> str:
        """A self-contained HTML page."""
        from markupsafe import Markup  # noqa: PLC0415 - comes with Jinja

        plots = [
            {"caption": each.caption, "alt": each.alt, "svg": Markup(each.svg)}
            for each in self._plots()
        ]
        found = (
            environment()
            .get_template("results.html.j2")
            .render(
                study=self.study,
                everybody=self.everybody,
                without=self.without,
                viewers=self.viewers,
                masters=self._by_master(),
                displays=self.displays,
                plots=plots,
                told=sum(bool(one.told) for one in self.viewers),
                scale_said=_scale_said(self.everybody),
            )
        )
        return str(found)

    def lines(self) -> list[str]:
        """What matters, for a terminal."""
        found = [
            f"{one.first} over {one.second}: {one.wins} of {one.trials} choices, {one.share:.0%} "
            f"({one.low:.0%} to {one.high:.0%}), p {_p(one.adjusted)}"
            + (", significant" if one.significant else "")
            for one in self.everybody.preferences
        ]
        found += [f"Viewer {one.name}: {', '.join(one.told)}" for one in self.viewers if one.told]
        return [*found, *self.displays]

    def _by_master(self) -> list[tuple[str, list[str]]]:
        """Name of a master, and of each pair the choices for its first method."""
        names = self.study.methods
        rows = []
        for master, wins in self.masters.items():
            cells = []
            for one in self.everybody.preferences:
                i, j = names.index(one.first), names.index(one.second)
                trials = wins[i, j] + wins[j, i]
                cells.append(f"{wins[i, j]} of {trials}" if trials else "–")
            rows.append((master, cells))
        return rows

    def _plots(self) -> list[Plot]:
        preferences = self.everybody.preferences
        share, low, high = 100 * np.array([(one.share, one.low, one.high) for one in preferences]).T

        def draw(axes: Any) -> None:
            axes.axvline(50, color="black", linewidth=1)
            rows = np.arange(len(preferences))
            for shift, some, colour, name in (
                (-0.12, self.everybody, COLOURS[0], "all viewers"),
                (0.12, self.without, COLOURS[1], "without those who are told of"),
            ):
                if some is None:
                    continue
                at, least, most = (
                    100 * np.array([(one.share, one.low, one.high) for one in some.preferences]).T
                )
                axes.errorbar(
                    at,
                    rows + (shift if self.without is not None else 0),
                    xerr=(at - least, most - at),
                    fmt="o",
                    capsize=3,
                    color=colour,
                    label=name,
                )
            axes.set_yticks(rows, [f"{one.first}\nover {one.second}" for one in preferences])
            axes.invert_yaxis()
            axes.set_xlim(0, 100)
            axes.set_xlabel("share of choices for the first, %")
            if self.without is not None:
                axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1), ncols=2)

        told = "; ".join(
            f"{one.first} over {one.second} {each:.0f} % ({least:.0f} to {most:.0f})"
            for one, each, least, most in zip(preferences, share, low, high, strict=True)
        )
        found = [
            plot(
                "Shares of choices, with 95 % intervals over viewers. At 50 % nobody prefers "
                "anything.",
                told,
                draw,
                (6.0, 1.4 + 0.7 * len(preferences)),
            )
        ]
        rows = _scale_rows(self.everybody)
        if rows:
            found.append(self._scale(rows))
        return found

    def _scale(self, rows: list[tuple[str, float, float | None]]) -> Plot:
        def draw(axes: Any) -> None:
            at = np.arange(len(rows))
            values = np.array([value for _, value, _ in rows])
            halves = np.array([half or 0 for _, _, half in rows])
            axes.errorbar(values, at, xerr=halves, fmt="o", capsize=3, color=COLOURS[2])
            axes.set_yticks(at, [name for name, _, _ in rows])
            axes.invert_yaxis()
            axes.set_xlabel(f"log-odds of being preferred to {rows[0][0]}")

        told = "; ".join(f"{name} {value:.2f}" for name, value, _ in rows)
        return plot(
            f"Scale values after Bradley and Terry, with 95 % intervals over viewers; "
            f"{rows[0][0]} is 0.",
            told,
            draw,
            (6.0, 1.2 + 0.4 * len(rows)),
        )


def analyse_study(study: Study, answers: Sequence[Answers]) -> Analysis:
    """What the answers of a study show.

    Raises
    ------
    InputError
        If fewer than two viewers have chosen anything.
    Missing
        Without statsmodels.
    """
    choosing = [one for one in answers if counts(study, one).any()]
    if len(choosing) < 2:
        raise InputError(
            f"a study wants answers of 2 or more viewers, got {len(choosing)}; ask more people"
        )
    wins = np.stack([counts(study, one) for one in choosing])
    everybody = audience(wins, study.methods)
    total = wins.sum(0)
    with np.errstate(invalid="ignore"):
        shares = total / (total + total.T)
    viewers = tuple(viewer(study, one, shares) for one in choosing)
    good = [k for k, one in enumerate(viewers) if not one.told]
    without = None
    if 2 <= len(good) < len(viewers):
        without = audience(wins[good], study.methods)
    return Analysis(
        study, everybody, without, viewers, by_master(study, choosing), _displays(study, choosing)
    )


def _displays(study: Study, answers: Sequence[Answers]) -> tuple[str, ...]:
    """What is to be said of the displays."""
    off = [
        f"{one.name} ({one.white:.3g} cd/m²)"
        for one in answers
        if one.white is not None and abs(one.white / study.white - 1) > BRIGHT
    ]
    unread = [one.name for one in answers if one.white is None and one.layout != "paper"]
    red = [one.name for one in answers if one.layout.startswith("anaglyph")]
    found = []
    if off:
        found.append(
            f"White is {study.white:.3g} cd/m²; it was more than {BRIGHT:.0%} off for viewers "
            f"{', '.join(off)}"
        )
    if unread:
        found.append(f"No white was read for viewers {', '.join(unread)}")
    if red:
        found.append(
            f"Red and cyan pictures, which have ghosts of their own, for viewers {', '.join(red)}"
        )
    return tuple(found)


def _told(found: Audience) -> dict[str, Any]:
    study = found.independent
    scale = None
    if isinstance(study.scale, Scale):
        halves = None if found.errors is None else [found.quantile * e for e in found.errors]
        scale = {"values": study.scale.values, "half_intervals": halves}
    return {
        "viewers_counted": max(one.viewers for one in found.preferences),
        "preferences": [asdict(one) for one in found.preferences],
        "scale": scale,
        "no_scale": None if isinstance(study.scale, Scale) else study.scale.reason,
        "pearson": study.pearson,
        "equality_p": study.equality.p,
    }


def _scale_rows(found: Audience) -> list[tuple[str, float, float | None]]:
    """Name, value and half of the interval of each method; nothing without a scale."""
    scale = found.independent.scale
    if not isinstance(scale, Scale):
        return []
    errors = found.errors or (None,) * len(found.names)
    return [
        (name, value, None if error is None else found.quantile * error)
        for name, value, error in zip(found.names, scale.values, errors, strict=True)
    ]


def _scale_said(found: Audience) -> str:
    """Whether one scale describes the choices."""
    scale = found.independent.scale
    if not isinstance(scale, Scale):
        return f"There is no scale: {scale.reason}."
    if scale.misfit is None:
        return ""
    return (
        f"Whether one scale describes all pairs: p {_p(scale.misfit.p)}, as if choices were "
        f"independent."
    )


def _p(value: float) -> str:
    return "below 0.0001" if value < 1e-4 else f"{value:.2g}"
