"""Crosstalk of a polarised 3D cinema by hand: one reflection, in Mueller calculus.

A projector's light is partly circular, a Stokes vector (1, 0, 0, p) with p = h (1 - e)/(1 + e) for
a filter of hand h = ±1 (right, left) and leak e. On the screen, at an irradiance E = cos(i)/d² of
unit intensity, a share s of the surface is Lambertian and forgets p; facets of the rest that are
turned half way between lamp and eye mirror it [1]::

    I = E (s rho/pi + (1 - s) rho D G R / (4 cos(i) cos(o)))     R = (|r_s|² + |r_p|²)/2
    V = E (1 - s) rho D G Re(r_s r_p*) p / (4 cos(i) cos(o))

with GGX's density of facets D, Smith's shadowing G and Fresnel's amplitudes r of aluminium [2].
Near the normal r_p = -r_s: the hand turns, V/I -> -p. Glasses of hand h' and leak e' pass
(I + q V)/2, q = h' (1 - e')/(1 + e'). A facet's linear polarisation does not pass them differently,
so no reference frames are needed; scattering between facets, walls and heads is left out.

The crosstalk of an eye is the other projector's light that it sees, over its own one's: for equal
illumination and ideal filters **c = (s rho/2) / (gain - s rho/2)**, with the gain pi I/E. It is
half of the depolarised share, over what is left, and rises where the gain lobe falls. For ideal
facets and leaks e, e' it is (1 - |p q|)/(1 + |p q|), about e + e'.

[1] B. Walter et al., Microfacet models for refraction through rough surfaces, EGSR 2007.
[2] M. Born, E. Wolf, Principles of Optics, sections 1.5 and 14.2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from domesim.errors import InputError
from domesim.stereo import CircularFilter, PolarisedProjector, SilverScreen, StereoTheatre

Floats = NDArray[np.float64]

ALUMINIUM = 0.963 + 6.70j
"""Refractive index at 551 nm (luxpop.com, as Mitsuba has it), absorption positive."""

_NODES = 4
"""Gauss-Legendre nodes across a cell of the screen, either way."""


def crosstalk_estimate(theatre: StereoTheatre, seat: str, rows: int, cols: int) -> Floats:
    """Relative crosstalk (eye, row, col) by receiving eye and place on the screen.

    Parameters
    ----------
    theatre
        The theatre.
    seat
        Name of the seat.
    rows, cols
        Cells of the screen; light is averaged over each.

    Returns
    -------
    ndarray
        The other picture's luminance over the eye's own, for equal pictures: in [0] for the left
        eye, in [1] for the right one.

    Raises
    ------
    InputError
        If there is no such seat, or no cells.
    """
    eye = theatre.seat(seat)
    points, weights = _cells(theatre.screen, rows, cols)
    own, other = (
        np.stack(
            [
                seen_luminance(
                    theatre.screen, theatre.projectors[e if mine else 1 - e], glass, eye, points
                )
                @ weights
                for e, glass in enumerate(theatre.eyewear)
            ]
        )
        for mine in (True, False)
    )
    return np.asarray(other / own)


def seen_luminance(
    screen: SilverScreen,
    projector: PolarisedProjector,
    glass: CircularFilter,
    eye: ArrayLike,
    points: Floats,
) -> Floats:
    """Luminance (...) of points of a lit screen through a filter.

    Parameters
    ----------
    screen, projector, glass
        What the light meets.
    eye
        (x, y, z), m.
    points
        (..., xyz) on the screen, m.

    Returns
    -------
    ndarray
        In units of the projector's intensity, after its filter, a square metre.
    """
    to_lamp, distance = _direction(points, projector.position)
    to_eye, _ = _direction(points, eye)
    intensity, circular = _reflected(screen, to_lamp, to_eye)
    irradiance = -to_lamp[..., 1] / distance**2
    sent, passed = _circularity(projector.filter), _circularity(glass)
    return np.asarray(irradiance * (intensity + passed * sent * circular) / 2)


def screen_gain(screen: SilverScreen, incidence: ArrayLike, viewing: ArrayLike = 0.0) -> Floats:
    """Brightness of a screen over that of a white Lambertian one, angles on opposite sides.

    Parameters
    ----------
    screen
        The screen.
    incidence, viewing
        Angles of lamp and eye to the normal, radians; both are positive on opposite sides, so that
        equal ones see the mirror direction.
    """
    angles = np.broadcast_arrays(-np.asarray(incidence, float), np.asarray(viewing, float))
    to_lamp, to_eye = (np.stack([np.sin(a), -np.cos(a), 0 * a], -1) for a in angles)
    return np.asarray(np.pi * _reflected(screen, to_lamp, to_eye)[0])


def _reflected(screen: SilverScreen, to_lamp: Floats, to_eye: Floats) -> tuple[Floats, Floats]:
    """Reflected I, and V of light that arrived with V = I = 1, an irradiance (1/sr)."""
    cos_lamp, cos_eye = -to_lamp[..., 1], -to_eye[..., 1]
    half = to_lamp + to_eye
    half = half / np.linalg.norm(half, axis=-1, keepdims=True)
    cos_half = -half[..., 1]
    square = screen.roughness**2
    facets = square / (np.pi * (cos_half**2 * (square - 1) + 1) ** 2)
    mirrored = facets * _unshadowed(cos_lamp, square) * _unshadowed(cos_eye, square)
    mirrored *= (1 - screen.depolarising_share) * screen.albedo / (4 * cos_lamp * cos_eye)
    s, p = _fresnel(np.sum(half * to_eye, axis=-1))
    scattered = screen.depolarising_share * screen.albedo / np.pi
    intensity = scattered + mirrored * (np.abs(s) ** 2 + np.abs(p) ** 2) / 2
    return intensity, np.asarray(mirrored * np.real(s * np.conj(p)))


def _unshadowed(cosine: Floats, square: float) -> Floats:
    """Smith's share of facets that nothing hides, for GGX."""
    return np.asarray(2 / (1 + np.sqrt(1 + square * (cosine**-2 - 1))))


def _fresnel(cosine: Floats) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Amplitudes reflected by aluminium across and in the plane of incidence; -1 times at 0."""
    square = ALUMINIUM**2
    inside = np.sqrt(square - (1 - cosine**2))
    across = (cosine - inside) / (cosine + inside)
    along = (square * cosine - inside) / (square * cosine + inside)
    return across, along


def _circularity(glass: CircularFilter) -> float:
    """Degree of circular polarisation behind a filter, above 0 for the right hand."""
    degree = (1 - glass.leak) / (1 + glass.leak)
    return degree if glass.hand == "right" else -degree


def _cells(screen: SilverScreen, rows: int, cols: int) -> tuple[Floats, Floats]:
    """Points (row, col, node, xyz) and weights (node) of a quadrature over each cell."""
    if rows < 1 or cols < 1:
        raise InputError(f"a crosstalk map needs rows and cols of at least 1, got {rows} x {cols}")
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    inner, pairs = nodes / 2 + 0.5, np.outer(weights, weights).ravel() / 4
    down = (np.arange(rows)[:, None, None, None] + inner[:, None]) / rows
    across = (np.arange(cols)[:, None, None] + inner) / cols
    down, across = (a.reshape(rows, cols, -1) for a in np.broadcast_arrays(down, across))
    x, z = (across - 0.5) * screen.width, (0.5 - down) * screen.height
    return np.stack([x, 0 * x, z], axis=-1), pairs


def _direction(points: Floats, place: ArrayLike) -> tuple[Floats, Floats]:
    """Unit vectors (..., xyz) from points to a place, and distances (...)."""
    way = np.asarray(place, float) - points
    distance = np.linalg.norm(way, axis=-1)
    return way / distance[..., None], distance
