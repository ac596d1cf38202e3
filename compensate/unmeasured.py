"""What an albedo costs that nobody measured: frames made for it, seen where it is another.

Frames are made for the albedo of the scene's file. They are looked at in the same theatre with an
albedo that is `OFF` lower or higher: what is seen of them there, of the untouched master, and of
frames that are made for the true albedo. The model of the room is the scene's own, so that nothing
but the albedo is wrong. White is as bright as the file says: a lux meter tells that, an albedo it
does not.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, final

import numpy as np

from compensate.bundled import bundled_night
from compensate.figures import Appraisal
from compensate.pose import Posed, Stage
from compensate.ruler import NO_DIFFERENCE
from compensate.solve import solved
from domesim.host.numbers import decimal
from domesim.light import Light
from domesim.light.blocks import light_means
from domesim.scene import DomeScene, Scene
from domesim.scene.screening import decoded, within_range

OFF = 0.3
"""How far an albedo may be off that was taken from a data sheet, or guessed, relative."""
_BLOCK = 2
"""Pixels a side that are averaged of the bundled night where it stands for all shows."""


@final
@dataclass(frozen=True)
class Truth:
    """Quality lost at one true albedo, JOD.

    Attributes
    ----------
    albedo
        Of the screen, holes counted in, weighed as luminance.
    untouched
        By the master as it is.
    guessed
        By the frames that were made for the file's albedo.
    known
        By frames that are made for the true one.
    """

    albedo: float
    untouched: float
    guessed: float
    known: float

    @property
    def gains(self) -> bool:
        """Whether the frames lose less than the master as it is, or nothing that counts."""
        lost = self.guessed
        return lost < NO_DIFFERENCE or lost <= self.untouched - NO_DIFFERENCE


@final
@dataclass(frozen=True)
class Unmeasured:
    """What frames lose if the file's albedo is off, by true albedo, rising; the file's is between.

    Attributes
    ----------
    truths
        At `OFF` below the file's albedo, at it, and at `OFF` above.
    """

    truths: tuple[Truth, ...]

    @property
    def lost(self) -> tuple[float, float]:
        """Least and most quality that the frames lose, JOD."""
        each = [truth.guessed for truth in self.truths]
        return min(each), max(each)

    @property
    def worth_doing(self) -> bool:
        """Whether the frames gain at all these albedos."""
        return all(truth.gains for truth in self.truths)

    @property
    def regained(self) -> float:
        """How much less is lost at most where the albedo is known, JOD."""
        return max(truth.guessed - truth.known for truth in self.truths)

    def told(self, what: str) -> str:
        """Says all that in one sentence; `what` names the picture."""
        low, file, high = self.truths
        advice = "worth doing unmeasured" if self.worth_doing else "measure first"
        more = ""
        if self.regained >= NO_DIFFERENCE:
            more = f"; to measure it would gain up to {self.regained:.2f} JOD more"
        return (
            f"if it is {decimal(low.albedo, 2)} to {decimal(high.albedo, 2)} "
            f"and not {decimal(file.albedo, 2)}, {what} loses {self.lost[0]:.2f} to "
            f"{self.lost[1]:.2f} JOD (untouched {low.untouched:.2f} to {high.untouched:.2f}): "
            f"{advice}{more}"
        )

    def figures(self) -> dict[str, Any]:
        """By their names, for programs."""
        return {
            "truths": [asdict(truth) for truth in self.truths],
            "lost": list(self.lost),
            "worth_doing": self.worth_doing,
        }


def unmeasured(posed: Posed, light: Light, appraisal: Appraisal | None = None) -> Unmeasured | None:
    """Computes what light loses that was made for an albedo which nobody measured.

    Parameters
    ----------
    posed
        A master in a dome.
    light
        (view, row, col, primary) what is projected for it.
    appraisal
        Of `posed`, if it is there already.

    Returns
    -------
    unmeasured
        None if the theatre is no dome, or its albedo was measured.
    """
    scene = posed.scene
    if not isinstance(scene, DomeScene) or scene.albedo_measured:
        return None
    low, high = (_truth(scene.with_albedo(1 + off), posed, light) for off in (-OFF, OFF))
    here = appraisal or Appraisal(posed)
    lost = here.loss(light)
    return Unmeasured((low, Truth(_albedo(scene), here.loss_before, lost, lost), high))


def by_the_night(scene: Scene) -> tuple[str, dict[str, Any]] | None:
    """Says what a scene's albedo costs, by the bundled night: for ``domesim scene check``.

    Parameters
    ----------
    scene
        A scene whose projectors reach all of its screen.

    Returns
    -------
    line, figures
        For people, and for programs; None as of `unmeasured`.
    """
    if not isinstance(scene, DomeScene) or scene.albedo_measured:
        return None
    night = decoded(bundled_night(), scene.one_eye)
    night = np.repeat(light_means(night, _BLOCK), scene.views, axis=0)
    posed = Stage(scene).pose(within_range(night, scene.screen(*night.shape[1:3]))[0])
    found = unmeasured(posed, solved(posed, "perceptual").light)
    if found is None:
        return None
    return f"Albedo not measured: {found.told('the bundled night')}", found.figures()


def _truth(scene: DomeScene, posed: Posed, light: Light) -> Truth:
    there = Stage(scene, posed.setting.eye).pose(posed.desired)
    seen = Appraisal(there)
    known = seen.loss(solved(there, "perceptual").light)
    return Truth(_albedo(scene), seen.loss_before, seen.loss(light), known)


def _albedo(scene: DomeScene) -> float:
    return float(scene.projector.luminance_weights @ np.asarray(scene.albedo))
