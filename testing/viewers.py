"""Viewers who null what they see, by made-up displays: sessions of `domesim measure by-eye`.

A viewer sees a change whose contrast is above Daly's threshold at that light, times a skill. They
stop turning when they see no more: before the null, by another distance on either side, and with
noise; they slip at times; the first settings are worse. The display has 8 bits, which the page
dithers, and its response is not what anybody expects.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import final

import numpy as np
from numpy.typing import NDArray

from compensate.vision.csf import daly
from domesim.light.transfer import named
from domesim.measure.by_eye.session import (
    Block,
    Kind,
    Session,
    Setting,
    Trial,
    blocks_of,
    trials_of,
)

Floats = NDArray[np.float64]

_SRGB = named("srgb", white=1.0)
FINEST = 255 * 64
USUAL = 2.2
WEIGHTS = {"W": 1.0, "R": 0.2126, "G": 0.7152, "B": 0.0722}
"""Luminance of the primaries of BT.709."""
SLIP = (0.3, 2.0)
"""Where a slip may end, of the null's light."""


@final
@dataclass(frozen=True)
class Display:
    """Code values -> light: sRGB's or a power law, off by a factor of its exponent."""

    exponent: float
    srgb: bool

    def light(self, code: float) -> float:
        """Light of a code, 0..1."""
        base = float(_SRGB.decode(np.array(code))) if self.srgb else code
        return float(np.power(base, self.exponent))

    def code(self, light: float) -> float:
        """The nearest code that dithering shows of that light."""
        root = max(light, 0.0) ** (1 / self.exponent)
        code = float(_SRGB.encode(np.array(root))) if self.srgb else root
        return round(min(code, 1.0) * FINEST) / FINEST


def display(random: np.random.Generator) -> Display:
    """A display of 2.2, 2.4 or sRGB, whose gamma is off by 0.1 (standard deviation)."""
    off = 0.1 * random.standard_normal()
    kind = random.integers(3)
    return Display((2.2, 2.4, 1.0)[kind] + (off / USUAL if kind == 2 else off), bool(kind == 2))


@final
@dataclass(frozen=True)
class Viewer:
    """Somebody who turns.

    Parameters
    ----------
    random
        Their noise.
    skill
        Contrast that they see, in thresholds.
    early
        How far before the null they stop, from below and from above, in what they see.
    learning
        How much worse their first settings are.
    slips
        Share of settings that are anywhere.
    """

    random: np.random.Generator
    skill: float
    early: tuple[float, float]
    learning: float
    slips: float

    def stops(self, trial: Trial, repeat: int, luminance: float) -> float:
        """Light that answers, less the null's, over the light that it is seen on."""
        contrast = float(
            1 / daly(1.0, 0.0, adaptation=max(luminance, 1e-3), image_area=900.0, distance=3.0)
        )
        seen = 2 * self.skill * contrast * (1 + self.learning * np.exp(-repeat / 2))
        above = trial.side == "above"
        return float(
            seen * ((1 if above else -1) * self.early[above] + self.random.standard_normal())
        )


def viewer(
    random: np.random.Generator,
    *,
    skill: float = 1.5,
    early: tuple[float, float] = (1.0, 1.0),
    slips: float = 0.03,
) -> Viewer:
    """One of many people, of ordinary skill unless said otherwise.

    Parameters
    ----------
    random
        Draws them, and their noise.
    skill
        Median of the contrast that they see, in thresholds.
    early
        Means of how far before the null they stop, from below and from above.
    slips
        Share of settings that are anywhere.
    """
    return Viewer(
        random,
        skill * float(np.exp(0.3 * random.standard_normal())),
        (early[0] * float(random.exponential()), early[1] * float(random.exponential())),
        float(random.exponential(0.3)),
        slips,
    )


@final
@dataclass
class Room:
    """What a viewer sits before.

    Parameters
    ----------
    kind
        Pairs, or a dome.
    displays
        Of each eye.
    shares
        Of each eye and primary: crosstalk; or the level that answers the rear half.
    white
        Luminance of white, cd/m².
    """

    kind: Kind
    displays: Mapping[str, Display]
    shares: Mapping[str, Mapping[str, float]]
    white: float
    _settings: list[Setting] = field(default_factory=list, init=False)

    def session(self, who: Viewer) -> Session:
        """All that they set."""
        self._settings = []
        trials, blocks = trials_of(self.kind), blocks_of(self.kind)
        for number, trial in enumerate(trials):
            limit = True
            while limit:
                setting = self._set(who, number, trial, blocks[trial.block])
                self._settings.append(setting)
                limit = setting.limit
        return Session(
            kind=self.kind,
            scene="made up",
            digest="",
            began="",
            settings=tuple(self._settings),
        )

    def _set(self, who: Viewer, number: int, trial: Trial, block: Block) -> Setting:
        before = self._of(trial.block)
        shown = self.displays[block.eye]
        bright = self.white * WEIGHTS[block.primary]
        slips = who.random.random() < who.slips
        slip = float(who.random.uniform(*SLIP))
        if block.task == "null" and self.kind == "stereo":
            base = self._grey(before)
            grey, null = shown.light(base), self.shares[block.eye][block.primary]
            found = (
                null * slip if slips else null + grey * who.stops(trial, len(before), bright * grey)
            )
            code = float(min(shown.code(grey - max(found, 0.0)), base))
            return self._setting(number, base, code, limit=code == 0)
        if block.task == "null":
            base, null, seen = 1.0, self.shares[block.eye][block.primary], 1.0
        else:
            base = 1.0
            if block.level > 1:
                base = float(np.median([each.code for each in self._of(trial.block - 1)]))
            null = shown.light(base) / 4
            # A dome's viewer sees the reflected light of the rear half
            seen = 1.0 if self.kind == "stereo" else self.shares[block.eye]["G"]
        found = null * (slip if slips else 1 + who.stops(trial, len(before), bright * null * seen))
        return self._setting(number, base, shown.code(found))

    def _of(self, block: int) -> list[Setting]:
        trials = trials_of(self.kind)
        return [each for each in self._settings if trials[each.trial].block == block]

    @staticmethod
    def _grey(before: list[Setting]) -> float:
        """As the page has it."""
        ghosts = [each.base**USUAL - each.code**USUAL for each in before]
        grey = float(np.clip(2.5 * np.median(ghosts), 0.015, 0.4)) if ghosts else 0.1
        return round(float(np.power(grey, 1 / USUAL)) * FINEST) / FINEST

    @staticmethod
    def _setting(number: int, base: float, code: float, *, limit: bool = False) -> Setting:
        return Setting(trial=number, base=base, code=code, limit=limit, seconds=8.0)
