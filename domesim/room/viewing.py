"""Where the picture is seen from, in the units of vision models: degrees and cd/m²."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.light.guarded import guarded
from domesim.room.dome import Dome

SQUARE_DEGREES = np.degrees(1.0) ** 2
"""Square degrees in a steradian."""
_DARKEST = 1e-5  # cd/m², below which Crumey holds thresholds


@guarded
def large_threshold(luminance: NDArray[np.floating]) -> NDArray[np.floating]:
    """Contrast at which a large area is just seen against what is around it, forced choice.

    A. Crumey, "Human contrast threshold and astronomical visibility", MNRAS 442, 2600 (2014),
    eq. 34, C of eqs. 39-44.

    Parameters
    ----------
    luminance
        Of what is around it, cd/m².
    """
    B = np.maximum(luminance, _DARKEST)
    root = np.sqrt(9.606e-6 * B**-0.5 - 4.112e-5 * B**-0.25 + 5.019e-5)
    return np.asarray(root + 4.837e-3 * B**-0.25 - 4.884e-3)


@final
@dataclass(frozen=True)
class DomeSeat:
    """A place under a dome from which figures and predictions are made.

    Parameters
    ----------
    dome
        The screen.
    position
        Place of the eyes in the room's frame, m, inside the dome's sphere or ellipsoid.
    """

    dome: Dome
    position: tuple[float, float, float]

    def __post_init__(self) -> None:
        x, y, z = (float(part) for part in np.asarray(self.position) @ self.dome.to_room)
        if not self.dome.encloses((x, y, z)):
            raise InputError(f"a seat must be inside {self.dome.whole}, got {self.position} m")

    def scale(self, rows: int, cols: int) -> NDArray[np.float32]:
        """Pixels per degree at the seat over those along a meridian at the centre.

        It is computed by the solid angle of the pixel: the geometric mean of both directions. What
        is seen aslant is finer in one of them, by the cosine; vision models here know one
        resolution.

        Parameters
        ----------
        rows, cols
            Size of the domemaster, pixels.

        Returns
        -------
        scale
            (row, col).
        """
        directions = self.dome.directions(rows, cols)
        way = self.dome.points(rows, cols) - np.asarray(self.position)
        distance = np.linalg.norm(way, axis=-1)
        normals = self.dome.normals(directions) @ self.dome.to_room.T
        cosine = np.sum(way * normals, axis=-1) / distance
        theta = np.arccos(np.clip(directions[..., 2], -1, 1))
        ring = np.sinc(theta / np.pi)  # of a pixel's solid angle at the centre
        seen = ring * self.dome.area_density(theta) * cosine / distance**2
        return np.asarray(1 / np.sqrt(np.maximum(seen, 1e-12)), np.float32)


@final
@dataclass(frozen=True)
class Viewing:
    """How large and how bright the picture is to an observer.

    Parameters
    ----------
    extent
        Angle that the picture's larger side covers, degrees.
    image_area
        Angular area of the picture, deg² (Daly's i²).
    distance
        Viewing distance, m (for accommodation).
    adaptation
        Luminance that the eye is adapted to, cd/m².
    seat
        A place in a dome away from the centre, from which figures and predictions are made; what is
        projected is made for the centre.
    """

    extent: float
    image_area: float
    distance: float
    adaptation: float
    seat: DomeSeat | None = None

    def __post_init__(self) -> None:
        for name in ("extent", "image_area", "distance", "adaptation"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise InputError(f"viewing {name} must be above 0, got {value:g}")

    def pixels_per_degree(self, rows: int, cols: int) -> float:
        """Resolution of a picture.

        Parameters
        ----------
        rows, cols
            Its size, pixels.

        Returns
        -------
        resolution
            Pixels per degree.
        """
        return max(rows, cols) / self.extent


def from_dome_centre(dome: Dome, adaptation: float) -> Viewing:
    """A seat in the centre of the sphere.

    There the equidistant mapping has the same pixels per degree along every meridian. Across them
    it is finer towards the rim, by theta / sin(theta): 1.57 at the rim of a hemisphere; vision
    models here take the meridian's value everywhere.

    Parameters
    ----------
    dome
        The screen.
    adaptation
        Luminance that the eye is adapted to, cd/m².

    Returns
    -------
    viewing
        Its extent is the dome's full angle.
    """
    return Viewing(
        extent=float(2 * np.degrees(dome.half_angle)),
        image_area=dome.solid_angle * SQUARE_DEGREES,
        distance=dome.radius,
        adaptation=adaptation,
    )


def of_flat_screen(width: float, height: float, distance: float, adaptation: float) -> Viewing:
    """A seat in front of a flat screen.

    The small-angle area (width / distance)(height / distance): the paper's screen, 2.5 m wide, 16:9
    and 3 m away, has 1282.3 deg².

    Parameters
    ----------
    width, height
        Of the screen, m.
    distance
        Of the seat from it, m.
    adaptation
        Luminance that the eye is adapted to, cd/m².

    Returns
    -------
    viewing
        Its extent is that of the longer side.
    """
    across = np.degrees(width / distance)
    return Viewing(
        extent=float(max(across, np.degrees(height / distance))),
        image_area=float(across * np.degrees(height / distance)),
        distance=distance,
        adaptation=adaptation,
    )
