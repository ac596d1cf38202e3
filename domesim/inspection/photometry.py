"""Brightness of a theatre, contrast in a dome, ghosts in 3D.

All is as observations say.

Figures are in cd/m² on the screen, means over its area. *White* is a white frame, *black* a black
one. The checkerboard is that of ``domesim measure patterns`` (12 sectors x 4 rings) and its
complement: *lit* and *dark* are the means of its white and its black fields, as ANSI contrast is
measured.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, final

import numpy as np
from numpy.typing import NDArray

from domesim.light import Light
from domesim.measure.patterns import Codes
from domesim.measure.patterns.dome import dome_patterns
from domesim.observation.base import Observation
from domesim.room.lenses import lens_gains
from domesim.scene import DomeScene, StereoScene
from domesim.scene.screening import mean_luminance

Floats = NDArray[np.float64]

BOARD = "checkerboard-12x4-"
"""Beginning of the patterns' names."""


@final
@dataclass(frozen=True)
class Photometry:
    """Figures of a dome theatre.

    Parameters
    ----------
    direct, reflected
        Direct and reflected luminance of a white frame, cd/m².
    black
        Luminance of a black frame, cd/m².
    lit, dark
        Luminances of the fields of a checkerboard, cd/m².
    lumens
        Flux of white on the screen, lm.
    evened
        (least, most) sum of the projectors' shares of a place, after their blends: 1 if the
        projection system evens them out.
    luminance
        (row, col) of a white frame, cd/m²; 0 off the screen.
    darkness
        (row, col) of a black frame, cd/m²; 0 off the screen.
    lift
        By how much black would rise, mean over the screen, cd/m², if the projectors hid the edges
        of their overlaps in it; None if no edge is seen.
    albedo
        (row, col, primary) albedo of a screen with a map, holes counted in; 0 off the screen. None
        if it is the same everywhere.
    """

    direct: float
    reflected: float
    black: float
    lit: float
    dark: float
    lumens: float
    evened: tuple[float, float]
    luminance: Floats
    darkness: Floats
    lift: float | None = None
    albedo: Floats | None = None

    @property
    def white(self) -> float:
        """Luminance of a white frame, cd/m²: direct, reflected and black together."""
        return self.direct + self.reflected + self.black

    @property
    def checkerboard(self) -> float | None:
        """Contrast of the checkerboard; None if its dark fields get no light at all."""
        return self.lit / self.dark if self.dark > 0 else None

    @property
    def sequential(self) -> float | None:
        """A white frame over a black one; None if black has no light."""
        return self.white / self.black if self.black > 0 else None

    @property
    def uneven(self) -> float:
        """Brightest place of a white frame over the darkest."""
        on = self.luminance[self.luminance > 0]
        return float(on.max() / on.min())

    @property
    def blackest(self) -> tuple[float, float]:
        """Luminance of a black frame at its darkest place and its brightest, cd/m²."""
        on = self.darkness[self.luminance > 0]
        return float(on.min()), float(on.max())

    def figures(self) -> dict[str, float | None]:
        """By their names, for programs."""
        albedo: dict[str, float | None] = {}
        if self.albedo is not None:
            on = self.albedo[self.luminance > 0]
            albedo = {"albedo_least": float(on.min()), "albedo_most": float(on.max())}
        return albedo | {
            "white_direct_cd_m2": self.direct,
            "white_reflected_cd_m2": self.reflected,
            "white_frame_cd_m2": self.white,
            "black_frame_cd_m2": self.black,
            "black_least_cd_m2": self.blackest[0],
            "black_most_cd_m2": self.blackest[1],
            "black_lift_cd_m2": self.lift,
            "checkerboard_lit_cd_m2": self.lit,
            "checkerboard_dark_cd_m2": self.dark,
            "checkerboard_contrast": self.checkerboard,
            "sequential_contrast": self.sequential,
            "white_unevenness": self.uneven,
            "lumens": self.lumens,
            "blend_sum_least": self.evened[0],
            "blend_sum_most": self.evened[1],
        }


def photometry(scene: DomeScene, size: int) -> Photometry:
    """The figures of a theatre, on domemasters of `size` x `size`.

    Raises
    ------
    InputError
        If its projectors leave a part of the screen dark.
    """
    observation, screen = scene.observation(size, size), scene.screen(size, size)
    areas = scene.pixel_areas(size, size)

    def mean(light: Light) -> float:
        return mean_luminance(light, scene, areas)

    black = np.zeros((1, size, size, 3), np.float64)
    white = np.where(screen[None, :, :, None], 1.0, black)
    seen = observation.observe(white)
    direct = observation.direct(white)
    dark = observation.observe(black)
    lit = [_fields(scene, observation, board, areas) for board in _boards(scene, size)]
    gains = lens_gains(scene.theatre, size, size)
    shares = areas / areas.sum()
    albedo = float(scene.projector.luminance_weights @ np.asarray(scene.albedo))
    irradiance = scene.projector.white * np.pi / albedo * float(np.sum(shares * gains.sum(0)))
    luminance = seen[0] @ scene.projector.luminance_weights
    painted = None
    if scene.theatre.paint is not None:
        factors = scene.theatre.paint.on(size, size) * np.asarray(scene.albedo)
        painted = np.where(screen[..., None], factors, 0.0)
    return Photometry(
        direct=mean(direct),
        reflected=mean(seen - direct) - mean(dark),
        black=mean(dark),
        lit=float(np.mean([each[0] for each in lit])),
        dark=float(np.mean([each[1] for each in lit])),
        lumens=irradiance * scene.dome.screen_area,
        evened=(float(gains.sum(0)[screen].min()), float(gains.sum(0)[screen].max())),
        luminance=np.where(screen, luminance * scene.projector.white, 0.0),
        darkness=np.where(screen, scene.projector.luminance(dark)[0], 0.0),
        lift=_lift(scene),
        albedo=painted,
    )


def _lift(scene: DomeScene) -> float | None:
    """Mean luminance that hides the edges of overlaps in black, cd/m²; None if none is seen."""
    theatre = scene.theatre
    if theatre.black_contrast is not None or not any(lens.black for lens in theatre.lenses):
        return None
    even = scene.with_even_black()
    lift = even.projector.black - scene.projector.black
    seen = even.theatre.black_contrast
    assert seen is not None
    return lift if lift > seen * scene.projector.black else None


def _boards(scene: DomeScene, size: int) -> list[NDArray[np.bool_]]:
    """(row, col): which pixels the checkerboard lights, and its complement."""
    patterns = dome_patterns(scene.dome, Codes(32, floating=True, transfer="linear"), 4)
    return [each.mask(size, size)[0] for each in patterns if each.name.startswith(BOARD)]


def _fields(
    scene: DomeScene,
    observation: Observation,
    board: NDArray[np.bool_],
    areas: NDArray[np.floating],
) -> Floats:
    """(lit, dark): mean luminance of the fields of a board."""
    size = len(board)
    light = np.repeat(board[None, :, :, None], 3, axis=3).astype(np.float64)
    seen = observation.observe(light)[0] @ scene.projector.luminance_weights
    on = scene.screen(size, size)
    return np.array(
        [
            float(np.sum((areas * seen)[fields]) / np.sum(areas[fields])) * scene.projector.white
            for fields in (board & on, ~board & on)
        ]
    )


class Ghost(NamedTuple):
    """Crosstalk at one seat.

    Attributes
    ----------
    matrices
        (eye, primary, primary of the other eye) means over the screen, of full primaries on black.
    shares
        (eye, row, col) light of a white frame for the other eye, over that of one's own, by
        luminance and without black: Woods' system crosstalk.
    """

    matrices: Floats
    shares: Floats


def ghost(scene: StereoScene, seat: str, size: tuple[int, int] = (9, 16)) -> Ghost:
    """Crosstalk at a seat, as the observation without lens and room says.

    Parameters
    ----------
    scene
        The stereo system.
    seat
        One of its seats.
    size
        Rows and cols of the screen.
    """
    observation = scene.seen_from(seat).crosstalk_alone.observation(*size)
    weights = scene.projector.luminance_weights

    def seen(left: Floats, right: Floats) -> Floats:
        """(eye, row, col, primary) of two flat frames."""
        pair = np.stack([left, right])[:, None, None, :]
        return np.asarray(observation.observe(np.broadcast_to(pair, (2, *size, 3)).copy()))

    none, white = np.zeros(3), np.ones(3)
    black, left, right = seen(none, none), seen(white, none), seen(none, white)
    own = np.stack([left[0] - black[0], right[1] - black[1]]) @ weights
    other = np.stack([right[0] - black[0], left[1] - black[1]]) @ weights
    matrices = np.empty((2, 3, 3))
    for primary, full in enumerate(np.eye(3)):
        matrices[0, :, primary] = (seen(none, full) - black)[0].mean((0, 1))
        matrices[1, :, primary] = (seen(full, none) - black)[1].mean((0, 1))
    return Ghost(matrices, other / own)
