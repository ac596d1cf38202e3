"""Light that goes from a flat screen to the room and back: radiosity of a box, of low rank.

The screen shows a place q with the luminance x(q) along its normal, and with gamma x(q) at an angle
of it. A patch i of the room gets the flux pi a_q G[q, i] x(q), G = gamma F by form factors F.
Surfaces are Lambertian, and exchange light, B = rho (E + F B), until it is spent. The screen takes
part in that with its albedo. What comes back to a place p is seen from along the normal as

    phi(p) = g / pi sum_i G[p, i] B_i,    Phi = g G R A^-1 G' a,    R = (I - rho F)^-1 rho

with g the screen's gain. Projector and audience are taken to be along the normal: by
reciprocity gamma counts light on its way back, too, and Phi is symmetric.

Form factors from a point to a rectangle are exact (Lambert's formula: half the sum over its edges
of the angle that an edge subtends, times the cosine between the normal and that of the plane of
point and edge, over pi). Phi is smooth: it is known at Gauss points of the screen, and a few
eigenvectors of that, polynomials over the screen, are kept as modes.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from domesim.observation.lowrank import LowRank, LowRankObservation
from domesim.room.flat_room import Face, FlatRoom

Floats = NDArray[np.float64]

_POINTS = (6, 9)  # Gauss points down and across the screen
_PATCH = 12  # of the room's longest side; they shrink towards the screen
_PARTS = 6  # of a patch, either way: what the screen sees of it varies
_KEPT, _MOST = 5e-3, 16  # of the strongest mode: weaker ones are left out; and how many are kept


class RoomModes(NamedTuple):
    """Phi = modes core modes' area, for each primary.

    Attributes
    ----------
    modes
        (mode, degree down, degree across) coefficients of Legendre polynomials over the screen, of
        mean square 1.
    core
        (primary, mode, mode) what they do to each other, symmetric.
    """

    modes: Floats
    core: Floats


_NOTHING = RoomModes(np.ones((1, 1, 1)), np.zeros((3, 1, 1)))


def room_observation(
    room: FlatRoom | None, rows: int, cols: int, black: float
) -> LowRankObservation:
    """Psi = x + Phi x + black of one view.

    Parameters
    ----------
    room
        The box and its screen; None for one that reflects nothing.
    rows, cols
        Size of the picture.
    black
        Light that is there without a picture, 1 = projector white.
    """
    modes = _NOTHING if room is None else room_modes(room)
    planes = _over_pixels(modes.modes, rows, cols)
    primaries = len(modes.core)
    ambient = np.broadcast_to(np.float32(black), (primaries, rows, cols))
    factors = LowRank(
        direct_gain=np.broadcast_to(1.0, (rows, cols)),
        spread=planes,
        core=modes.core / (rows * cols),
        collect=planes,
        ambient=ambient,
    )
    return LowRankObservation(factors, np.ones((rows, cols), np.bool_))


@lru_cache(maxsize=8)
def room_modes(room: FlatRoom) -> RoomModes:
    """The strong modes of a room; computed once."""
    nodes, weights = zip(*(legendre.leggauss(count) for count in _POINTS), strict=True)
    share = np.multiply.outer(weights[0] / 2, weights[1] / 2).ravel()
    phi = np.sqrt(share)[:, None] * _phi(room, nodes, share) * np.sqrt(share)
    values, vectors = np.linalg.eigh(np.einsum("pij,pkj->ik", phi, phi))
    # Of equal ones at this limit either may go; signs do not show, as modes stand on both sides
    kept = values > (_KEPT**2) * values[-1]
    kept[:-_MOST], kept[-1] = False, True  # a black room keeps one that does nothing
    vectors = vectors[:, kept]
    # Nodal values become coefficients: the polynomials are orthonormal at the Gauss points
    basis = [_orthonormal(node, count) for node, count in zip(nodes, _POINTS, strict=True)]
    grids = (vectors / np.sqrt(share)[:, None]).T.reshape(-1, *_POINTS)
    weighted = grids * share.reshape(_POINTS)
    modes = np.einsum("ri,sj,krs->kij", basis[0], basis[1], weighted)
    return RoomModes(modes, vectors.T @ phi @ vectors)


def _phi(room: FlatRoom, nodes: tuple[Floats, ...], share: Floats) -> Floats:
    """(primary, point, point) Phi for means over the screen: without the share of q."""
    width, height = room.screen
    z, x = np.meshgrid(-nodes[0] * height / 2, nodes[1] * width / 2, indexing="ij")
    points = np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1)
    toward = np.broadcast_to([0.0, 1.0, 0.0], points.shape)
    faces = room.faces()
    patches = [_patches(face, max(room.size) / _PATCH) for face in faces]
    corners, areas = (
        np.concatenate([each[k] for each in patches]) for k in range(2)
    )  # (patch, 4, xyz), (patch,)
    owner = np.repeat(np.arange(len(faces)), [len(each[1]) for each in patches])
    albedos = np.array([face.albedo for face in faces])[owner]
    own, fine = _to_parts(room, points, toward, corners)
    sent = fine.sum(axis=-1)
    between = np.zeros((len(areas), len(areas)))
    normals = np.stack([face.normal for face in faces])[owner]
    for u, v in np.ndindex(2, 2):  # Gauss points of a patch
        at = 0.5 + np.array([u - 0.5, v - 0.5]) / np.sqrt(3)
        places = corners[:, 0] + at[0] * (corners[:, 1] - corners[:, 0])
        places = places + at[1] * (corners[:, 3] - corners[:, 0])
        between += form_factors(places, normals, corners) / 4
    between[np.all(normals[:, None] == normals, axis=2)] = 0  # in one plane
    flow = between * areas[:, None]
    flow = (flow + flow.T) / 2  # A F is symmetric
    # The screen's points are patches, too
    a = share * width * height
    joined = np.block([[flow, (own * a[:, None]).T], [own * a[:, None], np.zeros((len(a),) * 2)]])
    joined /= np.concatenate([areas, a])[:, None]
    once = np.concatenate([sent.T / areas[:, None], np.zeros((len(a), len(a)))])
    rows = []
    for primary in range(albedos.shape[1]):
        rho = np.concatenate([albedos[:, primary], np.full(len(a), room.screen_albedo)])
        lit = rho[:, None] * once
        more = np.linalg.solve(np.eye(len(rho)) - rho[:, None] * joined, lit) - lit
        # What is reflected once is known by parts of patches
        back = fine * (rho[: len(areas)] * _PARTS**2 / areas)[:, None]
        first = back.reshape(len(points), -1) @ fine.reshape(len(points), -1).T
        rows.append(room.gain * width * height * (first + sent @ more[: len(areas)]))
    return np.stack(rows)


def _to_parts(
    room: FlatRoom, points: Floats, normals: Floats, corners: Floats
) -> tuple[Floats, Floats]:
    """Form factors of the screen's points: (point, patch), and by gain (point, patch, part)."""
    steps = np.arange(_PARTS + 1) / _PARTS
    first, second = corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]
    grid = (
        corners[:, None, None, 0]
        + steps[:, None, None] * first[:, None, None]
        + steps[None, :, None] * second[:, None, None]
    )
    parts = np.stack([grid[:, :-1, :-1], grid[:, 1:, :-1], grid[:, 1:, 1:], grid[:, :-1, 1:]], -2)
    parts = parts.reshape(-1, 4, 3)
    factors = form_factors(points, normals, parts)
    way = parts.mean(axis=1) - points[:, None]
    along = np.einsum("pki,pi->pk", way, normals) / np.linalg.norm(way, axis=-1)
    gained = factors * room.relative_gain(np.arccos(np.clip(along, 0, 1)))
    shape = (len(points), len(corners), _PARTS**2)
    return factors.reshape(shape).sum(-1), gained.reshape(shape)


def form_factors(points: Floats, normals: Floats, corners: Floats) -> Floats:
    """(point, patch) form factors from points to whole rectangles, which are before them.

    Parameters
    ----------
    points, normals
        (point, xyz).
    corners
        (patch, 4, xyz) of the rectangles, one after the other.
    """
    way = corners - points[:, None, None]
    way /= np.maximum(np.linalg.norm(way, axis=-1, keepdims=True), 1e-300)
    after = np.roll(way, -1, axis=-2)
    crossed = np.cross(way, after)
    length = np.linalg.norm(crossed, axis=-1)
    angle = np.arctan2(length, np.sum(way * after, axis=-1))
    turned = np.einsum("pkei,pi->pke", crossed, normals)
    parts = turned * np.divide(angle, length, out=np.zeros_like(angle), where=length > 1e-15)
    return np.asarray(np.abs(parts.sum(axis=-1)) / (2 * np.pi))


def _patches(face: Face, largest: float) -> tuple[Floats, Floats]:
    """Corners (patch, 4, xyz) and areas of a face's patches, finer where it is near the screen."""
    ends = []
    for side in (face.first, face.second):
        length = float(np.linalg.norm(side))
        even = np.linspace(0, 1, max(2, round(length / largest)) + 1)
        along = side[1] > 0 and face.corner[1] == 0  # away from the screen
        ends.append(even**2 if along else (1 - np.cos(np.pi * even)) / 2)
    u, v = np.meshgrid(*ends, indexing="ij")
    grid = face.corner + u[..., None] * face.first + v[..., None] * face.second
    corners = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], -2)
    sizes = np.multiply.outer(np.diff(ends[0]), np.diff(ends[1]))
    whole = float(np.linalg.norm(np.cross(face.first, face.second)))
    return corners.reshape(-1, 4, 3), (sizes * whole).ravel()


def _orthonormal(at: Floats, count: int) -> Floats:
    """(place, degree) Legendre polynomials of mean square 1 over -1..1."""
    return np.asarray(legendre.legvander(at, count - 1) * np.sqrt(2 * np.arange(count) + 1))


def _over_pixels(modes: Floats, rows: int, cols: int) -> NDArray[np.float32]:
    """(mode, row, col) of polynomials, at the middles of pixels; the first row is at the top."""
    down, across = (
        _orthonormal((2 * np.arange(size) + 1) / size - 1, count)
        for size, count in zip((rows, cols), modes.shape[1:], strict=True)
    )
    planes = down @ modes @ across.T
    return planes.astype(np.float32)
