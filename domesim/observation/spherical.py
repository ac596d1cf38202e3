"""The closed form of a Lambertian spherical cap: all bounces, O(n).

Between any two points of a sphere of radius r the form factor cos cos / (pi d²) is the constant
1 / (4 pi r²), so the indirect irradiance is the same everywhere. With direct flux
Phi = sum a_i E_i, albedo rho and the area A_s of the *whole* screen (lit or not: all of it
reflects), the bounces form a geometric series of ratio rho A_s / (4 pi r²):

    phi(x) = rho (a . x) / (4 pi r² - rho A_s)

Where paint multiplies rho by f(y), places send f x, and rho A_s is the integral of rho f. What a
place shows of the same light is times its own f.

This corrects eq. 15 of the paper: ``validation/notes/0001-eq15-corrected.md`` derives it.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from domesim.errors import InputError
from domesim.light import Array, Light
from domesim.light.guarded import guarded
from domesim.observation.lowrank import LowRank, LowRankObservation
from domesim.observation.transport import NODES, Transport
from domesim.room.dome import Dome
from domesim.room.theatre import Theatre


@guarded
def closed_form_gain(albedo: float, radius: float, screen_area: float, kept: float = 1.0) -> float:
    """Indirect light per direct flux: rho / (4 pi r² - rho A_s).

    Parameters
    ----------
    albedo
        Diffuse albedo rho of the screen, 0..1 (not its "gain").
    radius
        Radius r of the sphere, m.
    screen_area
        Area A_s of the whole screen, m².
    kept
        What each reflection keeps of it, -1..1, times rho: of the difference of two views
        (`domesim.observation.dome_pair`). All of light itself is kept.

    Returns
    -------
    gain
        In 1/m².

    Raises
    ------
    InputError
        If a value is impossible, or a closed sphere never loses light (albedo 1).
    """
    sphere = 4 * np.pi * radius**2
    if not (np.isfinite(radius) and radius > 0):
        raise InputError(f"radius must be above 0 m, got {radius:g}")
    if not 0 <= albedo <= 1:
        raise InputError(f"albedo must lie in 0..1, got {albedo:g}")
    if not 0 < screen_area <= sphere * (1 + 1e-12):
        raise InputError(
            f"screen area must be above 0 and at most the sphere's {sphere:g} m² for the closed "
            f"form, got {screen_area:g}; tabulate a tall dome"
        )
    if albedo * screen_area >= sphere:
        raise InputError("a closed sphere of albedo 1 never loses light; lower the albedo")
    reflected = kept * albedo
    return float(reflected / (sphere - reflected * screen_area))  # eq. 15


def bare_gain(albedo: float, dome: Dome, *, paint: float = 1.0, kept: float = 1.0) -> float:
    """Mean indirect light, on a bare cap, of direct light that is 1 everywhere.

    Parameters
    ----------
    albedo
        Albedo of the screen, 0..1.
    dome
        Shape of the screen. A tall dome, with more screen than its sphere, counts as a nearly
        closed sphere.
    paint
        Mean over the screen of what multiplies its albedo. Indirect light is that of a place
        where it is 1.
    kept
        See `closed_form_gain`.

    Returns
    -------
    gain
        Over the direct light.
    """
    sphere = 4 * np.pi * dome.radius**2
    area = dome.screen_area if dome.screen_area <= sphere * (1 + 1e-12) else 0.999 * sphere
    return closed_form_gain(albedo, dome.radius, area * paint, kept) * area


def bare_transport(theatre: Theatre, kept: float = 1.0) -> Transport:
    """The closed form of a theatre's screen, painted or not, as a transport.

    Parameters
    ----------
    theatre
        What else there is in it is left out.
    kept
        See `closed_form_gain`.

    Returns
    -------
    transport
        Its only mode is 1.
    """
    gains = [
        bare_gain(rho, theatre.dome, paint=paint, kept=kept)
        for rho, paint in zip(theatre.screen_albedo, theatre.mean_paint, strict=True)
    ]
    core = np.array(gains).reshape(3, 1, 1)
    modes, none = np.ones((1, NODES, NODES)), np.zeros((3, NODES, NODES))
    return Transport(theatre.dome, modes, core, np.zeros_like(core), none)


@final
class ClosedFormDome(LowRankObservation):
    """A dome theatre that is nothing but its Lambertian screen (eq. 15, corrected).

    Parameters
    ----------
    dome
        The screen.
    rows, cols
        Size of the domemaster, pixels.
    albedo
        Diffuse albedo of the screen, one a primary (or one for all `primaries`).
    lens_gain
        (row, col) direct gain D of an uncorrected projector lens; 1 everywhere if absent.
    ambient
        Light on the screen without a picture (1.0 = projector white), one a primary.
    primaries
        How many primaries the light has.
    kept
        See `closed_form_gain`.

    Raises
    ------
    InputError
        If an albedo is impossible or the picture is not square.
    """

    def __init__(
        self,
        dome: Dome,
        rows: int,
        cols: int,
        *,
        albedo: ArrayLike,
        lens_gain: NDArray[np.floating] | None = None,
        ambient: ArrayLike = 0.0,
        primaries: int = 3,
        kept: float = 1.0,
    ) -> None:
        albedos = np.broadcast_to(np.asarray(albedo, np.float64), (primaries,))
        areas = dome.kept_areas(rows, cols)
        screen = dome.inside(rows, cols)
        if lens_gain is not None and not bool(np.all(lens_gain[screen] > 0)):
            raise InputError("lens gain must be above 0 everywhere on the screen")
        # Outside the circle there is no screen: light there is left as it is.
        if lens_gain is None:
            gain, collect = np.broadcast_to(1.0, areas.shape), areas
        else:
            gain = np.where(screen, lens_gain, 1.0)
            collect = areas * gain
        spread = np.broadcast_to(np.float32(1), screen.shape)
        area = dome.screen_area
        gains = [closed_form_gain(float(rho), dome.radius, area, kept) for rho in albedos]
        offset = np.broadcast_to(np.asarray(ambient, np.float64), (primaries,))
        # Rank one: the screen, the gain, the pixels' areas times the direct gain
        dark = offset.astype(areas.dtype)[:, None, None]
        factors = LowRank(
            direct_gain=gain,
            spread=spread[None],
            core=np.asarray(gains).reshape(-1, 1, 1),
            collect=collect[None].astype(areas.dtype, copy=False),
            ambient=np.broadcast_to(dark, (primaries, *screen.shape)),
        )
        super().__init__(factors, screen)

    @cached_property
    def factors(self) -> LowRank:
        """See `LowRankObservation`."""
        found, screen = self._factors, self._screen
        ambient = _on(screen, found.ambient[:, 0, 0])
        return replace(found, spread=found.spread * screen, ambient=ambient)

    def screen_like(self, light: Light) -> Array:
        """See `LowRankObservation`: U's only mode."""
        return self.factors_like(light).spread[0, :, :]


def _on(screen: NDArray[np.bool_], offsets: NDArray[np.floating]) -> NDArray[np.floating]:
    """(primary, row, col) offsets on the screen; one plane in memory if they are all alike."""
    shape = (len(offsets), *screen.shape)
    if not offsets.any():
        return np.broadcast_to(offsets[:1, None, None], shape)
    if np.ptp(offsets):
        return offsets[:, None, None] * screen
    return np.broadcast_to(offsets[0] * screen, shape)
