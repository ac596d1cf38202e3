"""What a session found: lines for a person, figures for a program, and a scene file."""

from __future__ import annotations

import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from domesim.frames.colour import ProjectorResponse, transfer_in_words
from domesim.host.numbers import decimal
from domesim.light.transfer import named
from domesim.measure.by_eye.albedo import albedos_of
from domesim.measure.by_eye.estimate import Estimate, Response, Shares, estimated
from domesim.measure.by_eye.session import SETTINGS, Session, counted
from domesim.observation.uncertain import SIGMAS
from domesim.scene import DomeScene, StereoScene
from domesim.scene.writing import as_toml

Floats = NDArray[np.float64]

_OTHER = 0.1
"""Difference of light, as a logarithm, from which a stated response is another one."""
_WIDE = 0.3
"""Half of an interval, over its value, above which more settings are advised."""


class Result:
    """What a whole session tells of a scene.

    Parameters
    ----------
    scene
        What was measured, as it is described.
    session
        All of its settings.

    Raises
    ------
    InputError
        If no dome reflects what was set.
    """

    def __init__(self, scene: DomeScene | StereoScene, session: Session) -> None:
        self._session, self._stated = session, scene.projector.response
        self._estimate = estimated(counted(session))
        self._figures = [_figure(scene, shares) for shares in self._estimate.shares]

    def lines(self) -> list[str]:
        """The same for a person."""
        found = []
        for shares, (value, error) in zip(self._estimate.shares, self._figures, strict=True):
            found.append(_gamma(shares.eye, shares.response))
            found += _contradiction(shares.response, self._stated)
            parts = [
                f"{p} {_told(v, e, of_light=self._of_light)}"
                for p, v, e in zip("RGB", value, error, strict=True)
            ]
            what = f"crosstalk to the {shares.eye} eye" if self._of_light else "screen albedo"
            found.append(f"{what}: {', '.join(parts)} (95 %)")
        return [*found, *_habits(self._estimate), *self._advice()]

    def figures(self) -> dict[str, Any]:
        """The same for a program."""
        eyes = {
            shares.eye: {
                "value": value.tolist(),
                "standard_error": error.tolist(),
                "correlation": shares.correlation.tolist(),
                "level": shares.value.tolist(),
                "gammas": list(shares.response.gammas),
            }
            for shares, (value, error) in zip(self._estimate.shares, self._figures, strict=True)
        }
        return {
            "quantity": "crosstalk" if self._of_light else "screen albedo",
            "eyes": eyes,
            "learning": self._estimate.learning,
            "learning_standard_error": self._estimate.learning_error,
            "from_above_less_from_below": self._estimate.apart,
            "slips": self._estimate.slips,
            "settings": len(self._session.settings),
        }

    def scene_text(self, content: dict[str, Any], name: str, digest: str) -> str:
        """The scene's file with what was found in it.

        Parameters
        ----------
        content
            As it was (`domesim.scene.loading.scene_content`).
        name
            What it is called now.
        digest
            SHA-256 of the settings' file.
        """
        if self._of_light:
            return with_crosstalk(content, name, self._figures)
        (shares,) = self._estimate.shares
        ((value, error),) = self._figures
        measured = {
            "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
            "survey": SETTINGS,
            "unit": "by eye",
            "parameters": ["screen"],
            # The settings' own spread is their error: it explains them as well as can be
            "chi2": float(3 * _free(self._session)),
            "degrees_of_freedom": 3 * _free(self._session),
            "model_error": 0.0,
            "values": {"screen": _numbers(value)},
            "standard_errors": {"screen": _numbers(error)},
            "correlations": {
                f"{primary} screen": _numbers(row)
                for primary, row in zip("RGB", shares.correlation, strict=True)
            },
            "sha256": {SETTINGS: digest},
        }
        return with_albedo(content, name, value, measured)

    @property
    def _of_light(self) -> bool:
        return self._session.kind == "stereo"

    def _advice(self) -> list[str]:
        wide = any(
            SIGMAS * e > _WIDE * max(v, 1e-9)
            for value, error in self._figures
            for v, e in zip(value, error, strict=True)
        )
        return [
            *(
                ["crosstalk of one colour into another is not told by eye"]
                if self._of_light
                else []
            ),
            *(
                [f"some interval is wider than ±{_WIDE:.0%}: let another viewer do it, too"]
                if wide
                else []
            ),
        ]


def with_crosstalk(content: dict[str, Any], name: str, figures: list[tuple[Floats, Floats]]) -> str:
    """A stereo system's file with crosstalk as it was measured.

    Parameters
    ----------
    content, name
        As for `Result.scene_text`.
    figures
        Of each eye (primary,) crosstalk and its standard error.
    """
    crosstalk: dict[str, Any] = {}
    for eye, (value, error) in zip(("left", "right"), figures, strict=True):
        crosstalk[f"to_{eye}"] = _numbers(np.maximum(value, 0))
        crosstalk[f"to_{eye}_error"] = _numbers(error)
    return as_toml({**_renamed(content, name, "crosstalk"), "crosstalk": crosstalk})


def with_albedo(
    content: dict[str, Any], name: str, albedo: Floats, measured: dict[str, Any]
) -> str:
    """A dome's file with its albedo as it was measured, and the section that says how surely."""
    changed = _renamed(content, name, "screen.albedo")
    kept = 1 - changed["screen"].get("perforation", 0.0)
    changed["screen"] = {**changed["screen"], "albedo": _numbers(albedo / kept)}
    return as_toml({**changed, "measured": measured})


def _renamed(content: dict[str, Any], name: str, key: str) -> dict[str, Any]:
    sources = {k: text for k, text in content.get("sources", {}).items() if not k.startswith(key)}
    told = f"{content.get('description', '')} {key} by eye: {SETTINGS}.".strip()
    sources[key] = f"measured by eye: {SETTINGS}"
    return {**content, "name": name, "description": told, "sources": sources}


def _figure(scene: DomeScene | StereoScene, shares: Shares) -> tuple[Floats, Floats]:
    """(primary,) of a scene's key, and its standard error."""
    if isinstance(scene, StereoScene):
        return shares.value, shares.error
    albedo, slope = albedos_of(scene, shares.value)
    return albedo, slope * shares.error


def _free(session: Session) -> int:
    """Degrees of freedom of a primary's settings."""
    return len(counted(session)[-1].code) - 2


def _numbers(values: Floats) -> list[float]:
    return [float(f"{value:.6g}") for value in values]


def _told(value: float, error: float, *, of_light: bool) -> str:
    if of_light:
        return f"{value:.2%} ± {SIGMAS * error:.2%}"
    return f"{decimal(value, 3)} ± {decimal(SIGMAS * error, 2)}"


def _gamma(eye: str, response: Response) -> str:
    parts = (
        f"{gamma:.2f} down to 1/{4**level} of white"
        for level, gamma in enumerate(response.gammas, 1)
    )
    whose = "the display" if eye == "both" else f"the {eye} eye's display"
    return f"gamma of {whose}: {', '.join(parts)}"


def _contradiction(found: Response, stated: ProjectorResponse | None) -> list[str]:
    """What the scene states of the projector's response, if the matches say something else."""
    if stated is None:
        return []
    curve = named(stated.transfer, white=1.0)
    for level, gamma in enumerate(found.gammas, 1):
        log = -np.log(4.0) * level / gamma
        terms = np.array([log, log**2])
        off = float(np.log(max(float(curve.decode(np.exp([log]))[0]), 1e-9)) + np.log(4.0) * level)
        error = float(np.sqrt(terms @ found.covariance @ terms))
        if abs(off) > max(SIGMAS * error, _OTHER):
            return [
                f"  [projector] response says {transfer_in_words(stated.transfer)}, which gives "
                f"{np.exp(off):.2g} times that light there, at 1/{4**level} of white: frames made "
                f"for it would be wrong. State what was matched, or measure the response"
            ]
    return []


def _habits(estimate: Estimate) -> list[str]:
    """How the viewer turned."""
    change, error = estimate.learning, estimate.learning_error
    lines = [
        f"settings from above less those from below: {estimate.apart:+.0%}; their middle is taken",
        f"last settings less first ones: {change:+.0%} ± {SIGMAS * error:.0%}; "
        + (
            "the viewer was still learning, or tired: let them do it once more in another folder"
            if abs(change) > SIGMAS * error
            else "no learning is seen"
        ),
    ]
    if estimate.slips:
        lines.append(f"slips left out: {estimate.slips}")
    return lines
