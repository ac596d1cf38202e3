"""Crosstalk of a polarised 3D cinema by hand: one reflection, in Mueller calculus.

Light is a Stokes vector (I, Q, U, V). Q and U are in axes that lens and eye share: right,
and up, for an audience that faces the screen. V is above 0 for the right hand of what goes to the
audience, so that a mirror leaves all four as they are, and is below 0 for the right hand of what
goes to the screen.

A filter is a linear polariser of axis a and leak e, and a retarder at 45 degrees to it of 90 + eps
degrees. It sends, and as an analyser it passes with (I + q S)/2,

    q = D (-sin(eps) cos(2a), -sin(eps) sin(2a), h cos(eps)),   D = (1 - e)/(1 + e), h = ±1

If one of two filters should block the other, (1 - q q')/2 leaks: for parallel axes and no
leaks sin²((eps + eps')/2), for crossed ones sin²((eps - eps')/2). Errors of one sign add up in the
first and cancel in the second.

On the screen, at an irradiance E = cos(i)/d² of unit intensity, a share s of the surface is
Lambertian and forgets polarisation; facets of the rest that are turned half way between lamp and
eye mirror it [1]::

    S' = E (s rho/pi (I, 0, 0, 0) + (1 - s) rho D G M S / (4 cos(i) cos(o)))

with GGX's density of facets D, Smith's shadowing G and M of Fresnel's amplitudes r of aluminium
[2], in axes across and along the plane of incidence (r_p counts with its sign at the normal)::

    I' = (|r_s|² + |r_p|²)/2 I + (|r_s|² - |r_p|²)/2 Q        U' + iV' = r_s r_p* (U + iV)

and Q' with I and Q exchanged. Scattering between facets, walls and heads is left out.

The crosstalk of an eye is the other projector's light that it sees, over its own one's: for equal
illumination and ideal filters **c = (s rho/2) / (gain - s rho/2)**, with the gain pi I/E. It is
half of the depolarised share, over what is left, and rises where the gain lobe falls. For ideal
facets, quarter waves and leaks e, e' it is (1 - |p q|)/(1 + |p q|), about e + e'.

[1] B. Walter et al., Microfacet models for refraction through rough surfaces, EGSR 2007.
[2] M. Born, E. Wolf, Principles of Optics, sections 1.5 and 14.2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from domesim.errors import InputError
from domesim.light.guarded import guarded
from domesim.stereo.system import CircularFilter, PolarisedProjector, SilverScreen, StereoTheatre

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


@guarded(eye="3", points="... 3")
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
    sent = np.array([1, *_state(projector.filter, to_screen=True)])
    intensity, *polarised = np.moveaxis(_reflected(screen, to_lamp, to_eye, sent), -1, 0)
    passed = sum(
        q * part for q, part in zip(_state(glass, to_screen=False), polarised, strict=True)
    )
    return np.asarray(-to_lamp[..., 1] / distance**2 * (intensity + passed) / 2)


@guarded(incidence="*s", viewing="*s")
def screen_gain(screen: SilverScreen, incidence: ArrayLike, viewing: ArrayLike = 0.0) -> Floats:
    """Brightness of a screen over that of a white Lambertian one.

    Parameters
    ----------
    screen
        The screen.
    incidence, viewing
        Angles of lamp and eye to the normal, radians; both are positive on opposite sides, so that
        equal ones see the mirror direction.

    Returns
    -------
    gain
        Of the shape that both angles broadcast to.
    """
    angles = np.broadcast_arrays(-np.asarray(incidence, float), np.asarray(viewing, float))
    to_lamp, to_eye = (np.stack([np.sin(a), -np.cos(a), 0 * a], -1) for a in angles)
    unpolarised = np.array([1.0, 0, 0, 0])
    return np.asarray(np.pi * _reflected(screen, to_lamp, to_eye, unpolarised)[..., 0])


def _reflected(screen: SilverScreen, to_lamp: Floats, to_eye: Floats, sent: Floats) -> Floats:
    """(..., Stokes) reflected of `sent` (Stokes), an irradiance (1/sr)."""
    cos_lamp, cos_eye = -to_lamp[..., 1], -to_eye[..., 1]
    half = to_lamp + to_eye
    half = half / np.linalg.norm(half, axis=-1, keepdims=True)
    cos_half = -half[..., 1]
    square = screen.roughness**2
    facets = square / (np.pi * (cos_half**2 * (square - 1) + 1) ** 2)
    mirrored = facets * _unshadowed(cos_lamp, square) * _unshadowed(cos_eye, square)
    mirrored *= (1 - screen.depolarising_share) * screen.albedo / (4 * cos_lamp * cos_eye)
    scattered = screen.depolarising_share * screen.albedo / np.pi
    reflected = mirrored[..., None] * _by_facets(to_lamp, to_eye, half, sent)
    reflected[..., 0] += scattered * sent[0]
    return np.asarray(reflected)


def _by_facets(to_lamp: Floats, to_eye: Floats, normal: Floats, sent: Floats) -> Floats:
    """(..., Stokes) of what facets of aluminium of these normals mirror of `sent`."""
    s, p = _fresnel(np.sum(normal * to_eye, axis=-1))
    both, apart = (np.abs(s) ** 2 + np.abs(p) ** 2) / 2, (np.abs(s) ** 2 - np.abs(p) ** 2) / 2
    phase = -s * np.conj(p)  # at the normal r_p = -r_s, by axes that turn with the light
    across = np.cross(to_eye, to_lamp)
    length = np.linalg.norm(across, axis=-1, keepdims=True)
    # light that goes back where it came from has no plane of incidence, and needs none
    across = np.where(length > 1e-9, across / np.maximum(length, 1e-9), _axes(to_lamp)[0])
    turn = _turned(to_lamp, across)
    linear = (sent[1] + 1j * sent[2]) * np.conj(turn)
    mixed = phase * (linear.imag + 1j * sent[3])
    linear = apart * sent[0] + both * linear.real + 1j * mixed.real
    intensity = both * sent[0] + apart * ((sent[1] + 1j * sent[2]) * np.conj(turn)).real
    linear = linear * _turned(to_eye, across)
    return np.stack([intensity, linear.real, linear.imag, mixed.imag], axis=-1)


def _axes(towards: Floats) -> tuple[Floats, Floats]:
    """(..., xyz) right and up across light between the screen and a place that is so directed."""
    right = np.cross(-towards, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right, axis=-1, keepdims=True)
    return right, np.cross(right, -towards)


def _turned(towards: Floats, across: Floats) -> NDArray[np.complex128]:
    """exp(2i psi) of the angle psi from right to `across`."""
    right, up = _axes(towards)
    turn = np.sum(across * right, axis=-1) + 1j * np.sum(across * up, axis=-1)
    return np.asarray(turn**2 / np.abs(turn) ** 2)


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


def _state(glass: CircularFilter, *, to_screen: bool) -> tuple[float, float, float]:
    """Q, U and V that a filter sends for I = 1, which it passes best, too: q."""
    degree = (1 - glass.leak) / (1 + glass.leak)
    error, axis = np.radians(glass.retardance_error), np.radians(glass.axis)
    hand = 1 if (glass.hand == "right") != to_screen else -1
    linear = -degree * np.sin(error)
    return (
        float(linear * np.cos(2 * axis)),
        float(linear * np.sin(2 * axis)),
        float(hand * degree * np.cos(error)),
    )


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
