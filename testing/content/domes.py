"""Domemasters, (1, size, size, 3): the kinds of pictures that planetariums show.

The zenith is in the middle, the front at the bottom; the rim is 90 degrees from the zenith. What
lies outside the inscribed circle is black.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from domesim.light import Light
from testing.content.chess import chess
from testing.content.constellations import art_on_black
from testing.content.dome import Dome
from testing.content.portrait import face
from testing.content.sights import lava, network, skyline, spiral
from testing.content.texture import (
    Floats,
    Points,
    looked_up,
    magnitudes,
    mixed,
    noise,
    ridges,
    shape_tile,
    smoothstep,
    text_tile,
    tinted,
)


def star_field(size: int) -> Light:
    """Some 3000 stars, the Milky Way with its dust, and a brown glow at the horizon."""
    dome = Dome(size)
    random = np.random.default_rng(11)
    east, north, up = dome.turned(azimuth=0.6, altitude=0.5)
    latitude, longitude = np.arcsin(np.clip(up, -1, 1)), np.arctan2(east, north)
    x, y = longitude / (2 * np.pi), latitude / (2 * np.pi)
    bulge = np.exp(-((longitude / 0.5) ** 2))
    wide = 0.1 + 0.1 * bulge + 0.02 * noise(1, 2 * x, 2 * y, 1.8)
    band = np.exp(-(np.abs(latitude / wide) ** 1.4)) * (0.45 + 1.1 * bulge)
    band *= np.clip(1 + 0.3 * noise(2, 3 * x, 3 * y, 1.4), 0.2, None)
    lane = 0.045 * noise(3, 3 * x, 0.2, 1.8) * (0.5 + np.exp(-np.abs(longitude)))
    dust = np.exp(-(((latitude - 0.02 - lane) / 0.05) ** 2))
    dust = dust * np.clip(0.8 + 0.7 * noise(4, 3 * x, 5 * y, 1.3), 0, 1.6)
    milky = 0.018 * band[..., None] * np.exp(-dust[..., None] * np.array([0.9, 1.2, 1.5]))
    light = milky * np.array([1.0, 0.95, 0.9]) + np.array([0.0005, 0.0007, 0.0011])
    altitude = np.pi / 2 - dome.angle
    around = 0.7 + 0.5 * np.cos(dome.azimuth - 2.4)
    glow = np.exp(-altitude / 0.13) * around * (1 + 0.12 * noise(5, 0.7 * dome.x, 0.7 * dome.y))
    light += tinted(0.04 * glow, (1.0, 0.62, 0.36))

    places = dome.scattered(random, 2600)
    cloud = random.normal(0, 1, (9000, 2)) * np.array([1.1, 0.11])
    kept = dome.placed_turned(cloud[:, 0], cloud[:, 1], azimuth=0.6, altitude=0.5)[:900]
    places = np.concatenate([places, kept])
    light += dome.stars(places, magnitudes(random, len(places), 0.012), random)
    hills = 0.022 + 0.012 * noise(6, dome.azimuth / (2 * np.pi), 0.4, 1.5)
    return dome.light(light * smoothstep(-0.004, 0.004, altitude - hills)[..., None])


def nebula(size: int) -> Light:
    """Filaments of red and teal gas, dark lanes, a bright core, and stars."""
    dome = Dome(size)
    random = np.random.default_rng(21)
    x, y = 0.3 * dome.x, 0.3 * dome.y
    bent = 0.05 * noise(20, x, y, 2.0), 0.05 * noise(21, x, y, 2.0)
    u, v = x + bent[0], y + bent[1]
    away = np.hypot(dome.x - 0.15, dome.y - 0.25)
    shape = np.exp(-((away / 0.62) ** 2)) + 0.12 * np.exp(-away / 0.7)
    cloud = np.exp(0.9 * noise(22, u, v, 1.7) - 0.4) * shape
    thin = ridges(23, 1.5 * u, 1.5 * v, 1.7, 0.22) + 0.7 * ridges(24, 3 * u, 3 * v, 1.6, 0.2)
    inner = 1.6 * np.exp(-((away / 0.36) ** 2) + 0.5 * noise(25, u, v, 1.5))
    lanes = smoothstep(0.0, 1.5, noise(26, 1.2 * u + 0.3, 1.2 * v, 1.6) + 0.3 * away)
    dark = np.exp(-2.6 * lanes)
    red = (0.1 + 0.3 * thin) * cloud
    teal = (0.14 + 0.2 * ridges(27, 2.5 * u, 2.5 * v, 1.5, 0.25)) * inner
    light = tinted(red, (0.8, 0.07, 0.08)) + tinted(teal, (0.03, 0.5, 0.55))
    core = np.exp(-((away / 0.09) ** 2) + 0.3 * noise(28, 2 * u, 2 * v, 1.5))
    light += tinted(0.5 * core, (1.0, 0.78, 0.62))
    light += tinted(0.05 * cloud * (1 - shape), (0.15, 0.12, 0.8))
    light *= dark[..., None]
    light = 1 - np.exp(-1.15 * light)
    places = dome.scattered(random, 1700)
    light += dome.stars(places, magnitudes(random, len(places), 0.015), random)
    return dome.light(light + 0.0006)


def aurora(size: int) -> Light:
    """Curtains above a dark wood: green below, purple above, over a blue sky with stars."""
    dome, coarse = Dome(size), Dome(size, 1)
    random = np.random.default_rng(31)
    light = np.zeros((*coarse.x.shape, 3), np.float32)
    seen = coarse.angle < 1.46  # what is lower is faded out below
    slope, azimuth = np.tan(coarse.angle[seen]), coarse.azimuth[seen]
    right, front = np.sin(azimuth), np.cos(azimuth)
    curtains = np.zeros((len(slope), 3), np.float32)
    # Each height is a layer: where its noise crosses a level is a curtain's foot, seen upright
    heights = np.geomspace(95, 280, 22)
    for height in heights:
        x, y = (height * slope * side / 1500 for side in (right, front))
        x, y = x + 0.012 * noise(30, 1.5 * x, 1.5 * y, 1.8) + 0.1, y + 0.35
        foot = noise(37, 0.9 * x, 1.4 * y, 2.4) - 0.1
        wide = 0.045 * (1 + 0.15 * slope**2)  # layers must merge near the horizon
        sheet = np.exp(-((foot / wide) ** 2)) + 0.12 * np.exp(-((foot / 0.3) ** 2))
        rays = np.clip(0.7 + 0.6 * noise(32, 7 * x, 7 * y, 1.7) / (1 + 0.3 * slope), 0.08, None)
        patch = smoothstep(-0.9, 1.3, noise(33, 0.8 * x, 0.8 * y, 2.2))
        green = np.exp(-(height - 95) / 32) * smoothstep(88, 104, height)
        purple = 0.32 * np.exp(-(((height - 190) / 70) ** 2)) * smoothstep(100, 170, height)
        colour = green * np.array([0.12, 1.0, 0.42]) + purple * np.array([0.75, 0.16, 0.9])
        curtains += tinted(sheet * rays * patch, colour * (height / 95))
    light[seen] = curtains
    altitude = np.pi / 2 - coarse.angle
    light *= (0.22 * smoothstep(0.22, 0.8, altitude))[..., None]
    light = 1 - np.exp(-light)
    light += tinted(0.002 + 0.011 * np.exp(-altitude / 0.3), (0.22, 0.42, 1.0))
    sky = np.repeat(np.repeat(light, dome.fine, 0), dome.fine, 1)
    places = dome.scattered(random, 1300)
    sky += dome.stars(places, magnitudes(random, len(places), 0.01), random)
    turn = dome.azimuth / (2 * np.pi)
    trees = np.abs(np.mod(noise(34, turn, 0.1, 1.0) * 0.5 + 90 * turn, 1) - 0.5)
    wood = 0.05 + 0.02 * noise(35, turn, 0.2, 1.5) + 0.05 * (0.5 - trees)
    wood *= 1 + 0.12 * noise(36, 8 * turn, 0.5, 0.8)
    return dome.light(sky * smoothstep(-0.003, 0.003, np.pi / 2 - dome.angle - wood)[..., None])


def planetary_limb(size: int) -> Light:
    """A sunlit planet with clouds, seas and a terminator, its air at the limb, and stars."""
    dome = Dome(size)
    random = np.random.default_rng(41)
    radius = np.sin(0.95)
    right, up, ahead = dome.turned(azimuth=-0.35, altitude=0.12)
    off = np.arccos(np.clip(ahead, -1, 1))
    root = radius**2 - (1 - ahead**2)
    hit = (root > 0) & (ahead > 0)
    far = ahead - np.sqrt(np.clip(root, 0, None))
    normal = np.stack([far * right, far * up, far * ahead - 1], axis=-1) / radius
    turn, polar = np.arctan2(up, right), np.arccos(np.clip(-normal[..., 2], -1, 1))
    x, y = (polar * side(turn) / 3 for side in (np.cos, np.sin))
    bend = 0.03 * noise(40, x, y, 2.2), 0.03 * noise(41, x, y, 2.2)
    land = smoothstep(0.75, 0.95, noise(42, 1.3 * x + 0.3, 1.3 * y + 0.6, 1.7))
    rough = noise(43, 3 * x, 3 * y, 1.2)
    ground = mixed(
        tinted(np.clip(1 + 0.1 * rough, 0, None), (0.012, 0.04, 0.1)),
        tinted(np.clip(1 + 0.3 * rough, 0.2, None), (0.2, 0.17, 0.09)),
        land,
    )
    cover = noise(44, 1.2 * x + bend[0], 2.2 * (y + 0.4 * x) + bend[1], 1.5)
    cover = smoothstep(-0.35, 1.5, cover + 0.3 + 0.45 * noise(45, 5 * x, 7 * y + 3 * bend[0], 1.1))
    surface = mixed(ground, (0.84, 0.86, 0.88), 0.95 * cover)
    sun = np.array([0.72, 0.62, -0.32])
    day = normal @ (sun / np.linalg.norm(sun))
    lit = smoothstep(-0.06, 0.25, day) * np.clip(0.25 + 0.75 * day, 0.02, 1)
    dusk = np.exp(-((day - 0.04) ** 2) / 0.008)
    light = tinted(lit, (1, 1, 1)) * surface
    light *= 1 + dusk[..., None] * np.array([0.5, -0.05, -0.4])
    grazing = np.clip(normal[..., 2] + 1, 0, 1) ** 5
    air = lit[..., None] * grazing[..., None] * np.array([0.22, 0.42, 0.75])
    light = np.where(hit[..., None], light + air, 0)
    around = np.clip(np.cos(turn) * sun[0] + np.sin(turn) * sun[1] + 0.25, 0, None)
    halo = np.exp(-np.clip(off - 0.95, 0, None) / 0.022) * ~hit * around
    light += tinted(0.6 * halo, (0.3, 0.58, 1.0))
    places = dome.scattered(random, 1500)
    sky = dome.stars(places, magnitudes(random, len(places), 0.006), random)
    return dome.light(light + sky * (off > 0.96)[..., None])


def underwater(size: int) -> Light:
    """Blue water, bright at the surface above; rays, caustics, a reef, and fish before it."""
    dome = Dome(size)
    off = dome.angle + 0.05 * noise(50, 0.4 * dome.x, 0.4 * dome.y, 2.0)
    near = np.hypot(dome.x - 0.08, dome.y - 0.14)
    bright = np.exp(-((near / 0.3) ** 2)) + 0.2 * np.exp(-((near / 0.6) ** 2))
    deep = np.clip(off / (np.pi / 2), 0, 1)
    light = bright[..., None] * np.array([0.1, 0.42, 0.5]) + np.array([0.0005, 0.004, 0.011])
    light += np.exp(-3 * deep)[..., None] * np.array([0.005, 0.05, 0.12])
    u = dome.x + 0.06 * noise(51, 0.5 * dome.x, 0.5 * dome.y, 2.0)
    v = dome.y + 0.06 * noise(52, 0.5 * dome.x, 0.5 * dome.y, 2.0)
    net = _caustics(30 * u, 30 * v)
    light *= (0.85 + 0.6 * net * smoothstep(0.7, 0.1, near))[..., None]
    turn = np.arctan2(dome.y - 0.14, dome.x - 0.08) / (2 * np.pi)
    beams = smoothstep(0.2, 2.0, noise(55, 2 * turn, 0.05 * near, 1.0) + 0.3)
    beams = beams * np.exp(-((near - 0.25) ** 2) / 0.12) * smoothstep(0.05, 0.3, near)
    light += tinted(0.11 * beams, (0.2, 0.75, 0.9))

    around = dome.azimuth / (2 * np.pi)
    reef = 0.16 + 0.075 * noise(56, around, 0.3, 1.4)
    altitude = np.pi / 2 - dome.angle + 0.012 * noise(57, 4 * dome.x, 4 * dome.y, 1.2)
    rock = np.clip(0.6 + 0.5 * noise(58, 2 * dome.x, 2 * dome.y, 1.3), 0.05, None)
    floor = tinted(0.012 * rock * (1 + 2 * net), (0.35, 0.8, 0.75))
    corals = smoothstep(0.9, 1.6, noise(59, 3 * dome.x, 3 * dome.y, 1.7))
    floor = mixed(floor, tinted(0.03 * rock, (0.9, 0.35, 0.4)), corals)
    light = mixed(light, floor, smoothstep(0.01, -0.01, altitude - reef))
    fish, belly = _fish(dome)
    body = light * 0.12 + tinted(0.35 * belly, (0.25, 0.5, 0.55)) * light.max(axis=-1)[..., None]
    return dome.light(mixed(light, body, fish))


def film_frame(size: int) -> Light:
    """A frame of 16:9 by day on the front of the dome: hills and an actress; the rest is black."""
    dome = Dome(size)
    wide, ratio = 1.9, 9 / 16  # in units of the distance of the frame
    right, up, ahead = dome.turned(azimuth=0.0, altitude=0.8)
    along = np.maximum(ahead, 1e-3)
    x, y = right / along / wide + 0.5, -up / along / wide + ratio / 2
    frame = _film(round(0.55 * dome.samples), ratio)
    light = np.stack(
        [looked_up(np.ascontiguousarray(part), x, y) for part in np.moveaxis(frame, -1, 0)], axis=-1
    )
    return dome.light(light * (ahead > 0.1)[..., None])


def credits_roll(size: int) -> Light:
    """Three columns of names in white and grey on black, and a logo above them."""
    dome = Dome(size)
    tile = round(0.5 * dome.samples)
    light = np.zeros((*dome.x.shape, 3), np.float32)
    for azimuth, title, names in _CREDITS:
        right, up, ahead = dome.turned(azimuth=azimuth, altitude=0.52)
        along = np.maximum(ahead, 1e-3)
        x, y = right / along / 1.05 + 0.5, -up / along / 1.05 + 0.5
        heading = text_tile([(title, 0.075, 0.5, 0.13)], tile, tile)
        rows = [
            (part, 0.05, at, 0.27 + 0.08 * row)
            for row, name in enumerate(names)
            for part, at in zip(name, (0.28, 0.72), strict=True)
        ]
        roles = text_tile(rows[::2], tile, tile)
        people = text_tile(rows[1::2], tile, tile)
        here = ahead > 0.1
        light += tinted(looked_up(heading, x, y) * here, (0.9, 0.75, 0.35))
        light += tinted(looked_up(roles, x, y) * here, (0.32, 0.33, 0.36))
        light += tinted(looked_up(people, x, y) * here, (0.85, 0.85, 0.85))
    right, up, ahead = dome.turned(azimuth=0.0, altitude=1.5)
    u, v = right / np.maximum(ahead, 0.1), up / np.maximum(ahead, 0.1)
    away, turn = np.hypot(u, v), np.arctan2(v, u)
    ring = smoothstep(0.012, 0.006, np.abs(away - 0.16))
    shade = np.clip(0.45 + 2.5 * (v + 0.5 * u), 0.05, 1) * smoothstep(0.115, 0.108, away)
    rays = smoothstep(0.2, 0.5, np.cos(12 * turn)) * (np.abs(away - 0.21) < 0.025)
    logo = tinted(shade, (0.15, 0.4, 0.75)) + tinted(ring + 0.6 * rays, (0.85, 0.75, 0.45))
    return dome.light(light + logo * (ahead > 0.5)[..., None])


def _film(cols: int, ratio: float) -> Floats:
    """The frame of the film, (row, col, 3)."""
    rows = round(cols * ratio)
    y, x = ((grid / np.float32(cols)).astype(np.float32) for grid in np.mgrid[0.5:rows, 0.5:cols])
    high = y / ratio
    sky = mixed(tinted(np.ones_like(x), (0.18, 0.36, 0.68)), (0.7, 0.72, 0.7), high**1.2)
    clouds = smoothstep(0.2, 1.6, noise(60, 0.9 * x, 2.2 * y + 0.3 * y**2, 1.6))
    shaded = 0.85 + 0.06 * noise(61, 2 * x, 3 * y, 1.4)
    light = mixed(sky, tinted(shaded, (0.95, 0.93, 0.9)), 0.85 * clouds)
    ranges = (
        (0.26, 0.05, (0.3, 0.4, 0.52)),
        (0.33, 0.035, (0.16, 0.24, 0.2)),
        (0.41, 0.02, (0.1, 0.14, 0.045)),
    )
    for row, (top, rise, colour) in enumerate(ranges):
        crest = top + rise * noise(62, 0.5 * x + 0.3 * row, 0.2 + 0.3 * row, 1.7) * 0.6
        slope = noise(63, x + 0.4 * y, 1.5 * y, 1.9) - noise(63, x + 0.4 * y + 0.004, 1.5 * y, 1.9)
        grain = 1 + 0.22 * slope / slope.std() + 0.1 * noise(64, 4 * x, 6 * y, 0.9)
        hill = tinted(np.clip(grain, 0.15, None), colour)
        light = mixed(light, hill, smoothstep(-0.002, 0.002, y - crest))
    u, v = (x - 0.33) / 0.155, (y - 0.27) / 0.155
    portrait, cover = face(u, v, (0.65, -0.35, 0.6), 65)
    return mixed(light, portrait, cover).clip(0, 1)


def _caustics(x: Floats, y: Floats) -> Floats:
    """A net of light, 0 to 1, as waves cast it: sines that bend each other."""
    u, v = x, y
    total = np.zeros_like(x)
    for turn in (0.4, 1.9, 3.3, 4.2):
        u, v = (
            x + np.cos(turn - u) + np.sin(turn + v),
            y + np.sin(turn - v) + np.cos(turn + u),
        )
        total += 1 / np.hypot(1 / (np.sin(u + turn) + 1.3), 1 / (np.cos(v + turn) + 1.3))
    return np.clip(1 - np.abs(total / 4 - 0.85) / 0.12, 0, 1) ** 2


def _fish(dome: Dome) -> tuple[Floats, Floats]:
    """Coverage of fish, and how much light their bellies and backs return."""
    random = np.random.default_rng(51)
    outlines: list[list[tuple[float, float]]] = []
    schools = (
        ((0.40, 0.60), 0.7, 26, 0.018, 0.07),
        ((0.66, 0.42), -0.5, 16, 0.024, 0.06),
        ((0.27, 0.35), 2.4, 5, 0.05, 0.07),
        ((0.62, 0.74), 3.4, 1, 0.15, 0.0),
    )
    for centre, heading, count, length, spread in schools:
        for _ in range(count):
            middle = np.array(centre) + spread * random.standard_normal(2) * (1.4, 0.6)
            turn = heading + 0.18 * random.standard_normal()
            cos, sin = np.cos(turn), np.sin(turn)
            corners = np.array(_FISH) * length * random.uniform(0.8, 1.2)
            turned = corners @ np.array([[cos, sin], [-sin, cos]]) + middle
            outlines.append([(float(x), float(y)) for x, y in turned])
    cover = shape_tile(outlines, dome.samples, dome.samples)
    scales = np.clip(0.2 + 0.3 * noise(59, 6 * dome.x, 6 * dome.y, 1.2), 0, 1)
    return cover, scales


_FISH: Points = (
    (0.5, 0.0), (0.3, -0.12), (0.0, -0.16), (-0.25, -0.06), (-0.42, -0.16), (-0.5, -0.17),
    (-0.44, 0.0), (-0.5, 0.17), (-0.42, 0.16), (-0.25, 0.06), (0.0, 0.15), (0.3, 0.11),
)  # fmt: skip

_CREDITS = (
    (-1.35, "MUSIC", (
        ("Composer", "Ilse Brandt"), ("Cello", "Noor Haddad"), ("Piano", "T. Okafor"),
        ("Percussion", "Maja Lind"), ("Sound design", "R. Castellan"), ("Mixing", "Jun Arai"),
    )),
    (0.0, "THE SKY ABOVE", (
        ("Written by", "Clara Winther"), ("Directed by", "Pavel Novotny"),
        ("Narrator", "Amara Diallo"), ("Animation", "Studio Meridian"),
        ("Modelling", "Hugo Ferreira"), ("Lighting", "Sana Qureshi"),
        ("Compositing", "Lea Moreau"), ("Producer", "Erik Halvorsen"),
    )),
    (1.35, "SCIENCE", (
        ("Astronomy", "Dr Wei Zhang"), ("Geology", "Dr Ana Prieto"), ("Data", "Open archives"),
        ("Advisers", "K. Tanaka"), ("Education", "Ruth Adler"), ("Archive", "Old Observatory"),
    )),
)  # fmt: skip

DOMES: Mapping[str, Callable[[int], Light]] = {
    "art on black": art_on_black,
    "aurora": aurora,
    "film frame": film_frame,
    "star field": star_field,
    "planetary limb": planetary_limb,
    "text and credits": credits_roll,
    "underwater": underwater,
    "chess": chess,
    "nebula": nebula,
    "spiral": spiral,
    "skyline": skyline,
    "network": network,
    "lava": lava,
}
"""Name -> the size of a domemaster -> the domemaster."""
