"""Plain figures of what is seen: what ColorVideoVDP cannot see, in ratios and degrees.

ColorVideoVDP (`compensate.ruler`) compares each picture with its own light. So it hardly sees that
black has become grey, that contrast is gone from what is dark, or that all stars are one. These
figures say so, without a vision model. The master's *darker half* are the pixels of a view at or
below the median of its luminance on the screen.

*Black* is the mean luminance of the darker half, over the same as it is seen untouched.

*Contrast* is Weber's: with L_fine and L_coarse the mean luminances of a block and of the larger one
around it, both of the pixels of the darker four fifths only (`FAINT`), where lit things are not,

    c = (L_fine - L_coarse) / L_coarse,    L_coarse at least `BLACK`

What is seen of it is the slope of what is seen against the master, sum c c' / sum c^2: 1 is all, 0
is none, below 0 it is reversed. It is measured from 0.25 to 1 degree (texture) and from 2 to 10
degrees (the Milky Way). Of texture only that counts which is above the eye's threshold t at
L_coarse: c less t, and 0 below. So people match contrasts under a veil (the experiment `people`).
They were asked at 2 and 4 cycles/degree, which says nothing of the Milky Way.

*Stars* are points of the master: pixels `POINT` times as bright as all that lie two pixels away.
Their light is that of 3 x 3 pixels, less what lies around. One figure is the median of seen light
over the master's. The other is the share of pairs in order: where one star has `STEP` times the
light of the other, it is seen brighter by at least `SEEN_STEP`.

*Hue shift* is the mean angle between hues, (R - Y) / Y and (B - Y) / Y of the projector's R and B
and the luminance Y. Pixels count by the master's luminance times saturation.

The *sky* of a dome is the darker half. Its surface brightness, and the *faintest star* that is seen
in it, are magnitudes (`domesim.inspection.magnitudes`). A star's image is as large as the master's
are, and at least a pixel. The faintest star is one of the master: where a method gives stars half
as much light again, it has so much less in the master. A star projector's stars keep their light
whatever the video shows.

All but stars is measured in pictures of at most `ruler.FINEST` pixels a side: larger ones are
averaged first. A figure is None where the master has nothing that it could be measured on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property, partial, reduce
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from compensate.ruler import BLACK, averaged, require_pictures
from compensate.vision.castle import ACHROMATIC, castle
from domesim.inspection.magnitudes import Faintest, projected_star, sky_brightness, video_star
from domesim.light import Light, on_host
from domesim.light.blocks import block_sums
from domesim.light.guarded import guarded
from domesim.light.planes import Columns, Planes, planes_of
from domesim.light.strips import in_strips
from domesim.scene import DomeScene, Scene

FINE, COARSE = (0.25, 1.0), (2.0, 10.0)
"""Sides of a block, at least, and of the one around it, degrees."""
DARK, FAINT = 0.5, 0.8
"""Shares of the screen: the darker half, and where contrast is looked for."""
FLAT = 0.01
"""Root-mean-square contrast of a master below which it has none."""
POINT = 3.0
"""Ratio of a star to the brightest pixel around it, at least."""
STEP, SEEN_STEP = 1.25, 1.02
"""Ratio of the light of two stars that are told apart: in the master, and seen."""
GRATING = 1.0
"""Area of texture for castleCSF, deg²: that of the people's gratings (the experiment `people`)."""
STARS = 1000
"""Most stars that are compared in pairs."""
COLOURED = 20_000
"""Most pixels whose hues are compared, in all views together."""
GREY = 1e-4
"""Mean relative distance from grey below which a picture has no hue and no saturation."""

_BLOCK = 4  # pixels: stars are looked for in blocks that are twice as bright somewhere as in all

Floats = NDArray[np.floating[Any]]
Mask = NDArray[np.bool_]
Around: TypeAlias = Callable[[int, NDArray[np.intp], NDArray[np.intp]], NDArray[Any]]
"""A view, rows and columns of places -> (place, 5, 5, primary) light within two pixels of them."""


@final
@dataclass(frozen=True)
class PlainFigures:
    """Figures of what is seen; see the module's docstring.

    Attributes
    ----------
    black
        Luminance of the darker half over the untouched one's.
    contrast_fine, contrast_coarse
        Share of the contrast that is seen: above threshold, of 0.25 to 1 degree, and of 2 to 10
        degrees.
    stars, stars_in_order
        Light of stars over the master's, and share of pairs in order.
    hue_shift
        Degrees, 0 to 180.
    sky
        Surface brightness of the darker half, mag/arcsec².
    faintest_star, faintest_star_schaefer
        Magnitude of the faintest star of the master that is seen, by Crumey for a typical observer,
        and by Schaefer.
    projected_star, projected_star_schaefer
        The same of a star projector beside the video; None without one.
    """

    black: float | None = None
    contrast_fine: float | None = None
    contrast_coarse: float | None = None
    stars: float | None = None
    stars_in_order: float | None = None
    hue_shift: float | None = None
    sky: float | None = None
    faintest_star: float | None = None
    faintest_star_schaefer: float | None = None
    projected_star: float | None = None
    projected_star_schaefer: float | None = None


@final
@dataclass(frozen=True)
class Colours:
    """Hue and saturation of some pixels.

    Attributes
    ----------
    hue_shift
        Mean angle between hues, degrees, 0 to 180.
    saturation
        Saturation seen over the master's: 1 is kept, 0 is grey.
    """

    hue_shift: float
    saturation: float


@final
class PlainRuler:
    """Plain figures of what is seen of one master.

    Parameters
    ----------
    wanted
        (view, row, col, primary) what should be seen, or what tells it.
    scene
        Where.
    screen
        (row, col) pixels that count.
    small
        `wanted` as it is `averaged`, if that is known.

    Raises
    ------
    InputError
        If `wanted` is no light, or the screen is not of its size or empty.
    """

    def __init__(
        self, wanted: Light | Planes, scene: Scene, screen: Mask, small: Light | None = None
    ) -> None:
        if callable(wanted):
            self._planes = wanted
        else:
            require_pictures("PlainRuler", screen, wanted)
            wanted = on_host(wanted)
            self._planes = planes_of(wanted)
        self._scene, self._screen = scene, screen
        self._small = averaged(wanted, screen) if small is None else small

    def black(self, seen: Light) -> float:
        """Returns the mean luminance of the darker half as it is seen, cd/m².

        Parameters
        ----------
        seen
            (view, row, col, primary), or `averaged`.
        """
        return self._black(self._luminance(averaged(self._given(seen), self._screen)))

    def _given(self, seen: Light) -> Light:
        """What is seen, as a NumPy array."""
        require_pictures("PlainRuler", self._screen, seen)
        return on_host(seen)

    def figures(self, seen: Light, untouched: float, around: Around | None = None) -> PlainFigures:
        """Computes all figures.

        Parameters
        ----------
        seen
            (view, row, col, primary), or `averaged`.
        untouched
            `black` of what is seen untouched, cd/m².
        around
            Of all pixels that are seen, if `seen` is averaged.

        Returns
        -------
        figures
            See `PlainFigures`.
        """
        seen = self._given(seen)
        small = averaged(seen, self._screen)
        light = self._luminance(small)
        colours = of_colours(self._sampled(self._small), self._sampled(small), self._weights)
        fine, coarse = (None if band is None else band.seen(light) for band in self._bands)
        black, (stars, in_order) = (
            self._black(light),
            self._stars(around or partial(around_of, planes_of(seen))),
        )
        return PlainFigures(
            black / untouched if untouched > 0 else None,
            fine,
            coarse,
            stars,
            in_order,
            None if colours is None else colours.hue_shift,
            *self._sky(black, stars),
        )

    def at_stars(self, around: Around) -> Around:
        """Looks around the master's stars now: what is returned needs no picture."""
        found = [around(view, rows, cols) for view, (rows, cols, *_) in enumerate(self._points)]
        return lambda view, rows, cols: found[view]

    def of_master(self, untouched: float) -> PlainFigures:
        """`figures` of the master itself."""
        return self.figures(self._small, untouched, partial(around_of, self._planes))

    def faintest(self, black: float, stars: float | None = None) -> Faintest | None:
        """Computes the faintest star of the master that is seen.

        Parameters
        ----------
        black
            Of what is seen, cd/m².
        stars
            Light of stars over the master's; None where there are none.

        Returns
        -------
        faintest
            None in a scene without a sky, which only a dome has, or if stars have no light at all.
        """
        more = 1.0 if stars is None else stars
        if not (isinstance(self._scene, DomeScene) and more > 0):
            return None
        brighter = 2.5 * float(np.log10(more))
        return video_star(self._scene, black, self._image).fainter(brighter)

    def projected(self, black: float) -> Faintest | None:
        """Computes the faintest star of a star projector beside the video; None without one."""
        return projected_star(self._scene, black) if isinstance(self._scene, DomeScene) else None

    def _sky(self, black: float, stars: float | None) -> tuple[float | None, ...]:
        """Surface brightness and faintest stars of a dome's sky."""
        brightness, faintest = sky_brightness(black), self.faintest(black, stars)
        shown = isinstance(self._scene, DomeScene) and np.isfinite(brightness)
        schaefer, crumey = faintest or (None, None)
        schaefer_projected, crumey_projected = self.projected(black) or (None, None)
        sky = brightness if shown else None
        return sky, crumey, schaefer, crumey_projected, schaefer_projected

    @cached_property
    def _image(self) -> float:
        """Solid angle of a star's image, sr: the median of the master's, and at least a pixel."""
        pixel = np.radians(1 / self._scene.viewing.pixels_per_degree(*self._screen.shape)) ** 2
        spreads = np.concatenate([spread for _, _, _, spread in self._points])
        return float(pixel * max(1.0, np.median(spreads) if spreads.size else 1.0))

    @property
    def _weights(self) -> Floats:
        return self._scene.projector.luminance_weights

    @cached_property
    def _dark(self) -> Mask:
        """(view, row, col) the darker half."""
        return self._darker(DARK)

    def _darker(self, share: float) -> Mask:
        """(view, row, col) the darker `share` of the screen: of pixels that wholly lie on it."""
        darker = np.zeros(self._master.shape, np.bool_)
        if self._whole.any():
            for view, dark in zip(self._master, darker, strict=True):
                values = view[self._whole]
                last = int(share * (values.size - 1))
                np.less_equal(view, np.partition(values, last)[last], out=dark)
        return darker & self._whole

    @cached_property
    def _whole(self) -> Mask:
        """(row, col) pixels that wholly lie on the screen."""
        ones = np.broadcast_to(np.float32(1), (1, *self._screen.shape, 1))
        return np.asarray(averaged(ones, self._screen)[0, ..., 0] > 1 - 1e-6)

    @cached_property
    def _master(self) -> Floats:
        return self._luminance(self._small)

    def _black(self, luminance: Floats) -> float:
        total = np.sum(luminance, where=self._dark, dtype=np.float64)
        return float(total) / max(int(np.count_nonzero(self._dark)), 1)

    @cached_property
    def _bands(self) -> list[_Contrast | None]:
        """Fine and coarse contrast."""
        per_degree = self._scene.viewing.pixels_per_degree(*self._small.shape[1:3])
        faint = self._darker(FAINT)
        bands: list[_Contrast | None] = []
        for fine, coarse in (FINE, COARSE):
            block = int(np.ceil(fine * per_degree))
            times = round(coarse * per_degree / block)
            seen = _texture if (fine, coarse) == FINE else None
            band = _Contrast(self._master, faint, block, times, seen) if times > 1 else None
            bands.append(band if band and band.is_there else None)
        return bands

    def _sampled(self, light: Light) -> Light:
        """(pixel, primary) at most `COLOURED` pixels of the darker half."""
        return np.concatenate(
            [view[rows, cols] for view, (rows, cols) in zip(light, self._sample, strict=True)]
        )

    @cached_property
    def _sample(self) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
        step = -(-np.count_nonzero(self._dark) // COLOURED) or 1
        places = (np.nonzero(view) for view in self._dark)
        return [(rows[::step], cols[::step]) for rows, cols in places]

    def _luminance(self, light: Light) -> Floats:
        """(view, row, col), cd/m²."""
        return self._scene.projector.luminance(light.astype(np.float32, copy=False))

    @cached_property
    def _points(self) -> list[tuple[NDArray[np.intp], NDArray[np.intp], Floats, Floats]]:
        """Rows, cols, light of the stars of each view, and the pixels over which it is spread."""
        points, weights = [], self._star_weights
        for view in range(len(self._small)):
            rows, cols = self._candidates(view)
            near = around_of(self._planes, view, rows, cols) @ weights
            on_screen = around_of_plane(self._screen, rows, cols).all(axis=(1, 2))
            peak = near[:, 2, 2]
            stars = on_screen & (peak >= near.max(axis=(1, 2)))
            stars &= peak >= POINT * near[:, _RING].max(axis=1)
            near = near[stars].astype(np.float64)
            light, peak = _light_of(near), near[:, 2, 2] - near[:, _RING].mean(axis=1)
            points.append((rows[stars], cols[stars], light, light / peak))
        return points

    @property
    def _star_weights(self) -> Floats:
        """(primary,) luminance, cd/m², in single precision."""
        return (self._weights * self._scene.projector.white).astype(np.float32)

    def _candidates(self, view: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Rows and cols of pixels of a view that are the brightest of a block, and twice its mean.

        They lie two pixels from the picture's edge at least.
        """
        (rows, cols), columns = self._screen.shape, Columns(self._screen)
        weights = self._star_weights
        if min(rows, cols) < _BLOCK:
            return np.zeros(0, np.intp), np.zeros(0, np.intp)

        def look(_: int, blocks: slice) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
            some = slice(_BLOCK * blocks.start, _BLOCK * blocks.stop)
            beside = columns.of(some, _BLOCK)
            beside = slice(beside.start, beside.stop // _BLOCK * _BLOCK)
            planes = self._planes(view, some, beside)
            Y = reduce(np.add, (w * x for w, x in zip(weights, planes, strict=True)))
            top = reduce(np.maximum, (Y[k::_BLOCK] for k in range(_BLOCK)))
            brightest = reduce(np.maximum, (top[:, k::_BLOCK] for k in range(_BLOCK)))
            lone = brightest > np.maximum(2 / _BLOCK**2 * block_sums(Y, _BLOCK), BLACK)
            row, col = np.nonzero(lone)
            at = np.arange(_BLOCK)
            of_block = _BLOCK * row[:, None, None] + at[:, None], _BLOCK * col[:, None, None] + at
            within = Y[of_block].reshape(row.size, _BLOCK**2).argmax(axis=1)
            row, col = _BLOCK * row + within // _BLOCK, _BLOCK * col + within % _BLOCK
            return row + some.start, col + beside.start

        strips = in_strips(look, (1, rows // _BLOCK, _BLOCK * cols * len(weights)))
        row, col = (np.concatenate(each) for each in zip(*strips, strict=True))
        inside = (row >= 2) & (col >= 2) & (row < rows - 2) & (col < cols - 2)
        return row[inside], col[inside]

    def _stars(self, around: Around) -> tuple[float | None, float | None]:
        """Light of stars over the master's, and share of pairs in order."""
        wanted = np.concatenate([light for _, _, light, _ in self._points])
        if not wanted.size:
            return None, None
        stars = np.concatenate(
            [
                _light_of(around(view, rows, cols) @ self._star_weights)
                for view, (rows, cols, *_) in enumerate(self._points)
            ]
        )
        ranks = np.argsort(wanted, kind="stable")[:: -(-wanted.size // STARS)]
        master, other = wanted[ranks], stars[ranks]
        apart = master[:, None] >= STEP * master
        kept = apart & (other[:, None] >= SEEN_STEP * np.maximum(other, 0))
        pairs = np.count_nonzero(apart)
        order = float(np.count_nonzero(kept) / pairs) if pairs else None
        return float(np.median(stars / wanted)), order


@guarded(master="pixel primary", seen="pixel primary", luminance_weights="primary")
def of_colours(master: Floats, seen: Floats, luminance_weights: Floats) -> Colours | None:
    """Compares the hue and saturation of pixels with the master's.

    Parameters
    ----------
    master, seen
        (pixel, primary) light.
    luminance_weights
        (primary,): share of each in the luminance of white.

    Returns
    -------
    colours
        None if all pixels are grey or black.
    """
    master_hues, Y = _opponent(master, luminance_weights)
    seen_hues, _ = _opponent(seen, luminance_weights)
    weight = np.abs(master_hues) * Y
    if not weight.sum() > GREY * Y.sum():
        return None
    turn = weight @ np.abs(np.angle(seen_hues * np.conj(master_hues), deg=True)) / weight.sum()
    return Colours(float(turn), float(weight @ np.abs(seen_hues) / (weight @ np.abs(master_hues))))


def _opponent(colours: Floats, luminance_weights: Floats) -> tuple[NDArray[Any], Floats]:
    """Complex (R - Y) / Y + i (B - Y) / Y of (pixel, primary) light, and Y."""
    light = np.asarray(colours, np.float64)
    brightness = light @ luminance_weights
    red_blue = light[:, 0] + 1j * light[:, 2] - (1 + 1j) * brightness
    return red_blue / np.maximum(brightness, 1e-6), brightness


@final
class _Contrast:
    """Contrast of blocks against blocks of `times` x `times` of them, where a master is faint."""

    def __init__(
        self,
        master: Floats,
        faint: Mask,
        block: int,
        times: int,
        seen: Callable[[Floats, Floats], Floats] | None,
    ) -> None:
        """`seen` tells how much of contrasts is seen, from them and the luminance around, cd/m²."""
        self._faint, self._block, self._times, self._seen = faint, block, times, seen
        self._count = [block_sums(view.astype(np.float32), block) for view in faint]
        self._more = [np.maximum(block_sums(count, times), 1) for count in self._count]
        contrasts = self._of(master)
        # The master's contrast, which counts by how many pixels a block has
        self._weighted = [c * count for c, count in zip(contrasts, self._count, strict=True)]
        self._power = sum(
            float(np.sum(w * c, dtype=np.float64))
            for w, c in zip(self._weighted, contrasts, strict=True)
        )
        pixels = sum(float(count.sum(dtype=np.float64)) for count in self._count)
        self.is_there = self._power > FLAT**2 * pixels

    def seen(self, luminance: Floats) -> float:
        """Share of the master's contrast in (view, row, col) luminance, cd/m²."""
        contrasts = self._of(luminance)
        product = sum(
            float(np.sum(w * c, dtype=np.float64))
            for w, c in zip(self._weighted, contrasts, strict=True)
        )
        return product / self._power

    def _of(self, luminance: Floats) -> list[Floats]:
        """Weber contrast of the blocks of each view; 0 where none is faint."""
        contrasts = []
        for view, faint, count, more in zip(
            luminance, self._faint, self._count, self._more, strict=True
        ):
            sums = block_sums(np.where(faint, view, np.float32(0)), self._block)
            rows, cols = sums.shape
            around = np.maximum(block_sums(sums, self._times) / more, np.float32(BLACK))
            around = around.repeat(self._times, 0).repeat(self._times, 1)[:rows, :cols]
            contrast = np.where(count > 0, sums / (np.maximum(count, 1) * around) - 1, 0)
            contrasts.append(contrast if self._seen is None else self._seen(contrast, around))
        return contrasts


def _texture(contrast: Floats, around: Floats) -> Floats:
    """How far Weber contrasts of texture lie above threshold; 0 below it."""
    log, threshold = _thresholds()
    t = np.interp(np.log10(around), log, threshold).astype(contrast.dtype)
    return np.asarray(np.sign(contrast) * np.maximum(np.abs(contrast) - t, 0))


@cache
def _thresholds() -> tuple[Floats, Floats]:
    """Log10 of luminances from `BLACK` up, cd/m², and the threshold contrast of texture there."""
    luminance = np.geomspace(BLACK, 1e4, 400)
    frequency = 1 / (
        2 * np.sqrt(FINE[0] * FINE[1])
    )  # periods of two blocks, and of two coarse ones
    return np.log10(luminance), 1 / castle(frequency, luminance, ACHROMATIC, area=GRATING)


_RING = np.pad(np.zeros((3, 3), np.bool_), 1, constant_values=True)
"""(5, 5): the pixels two pixels away."""


def around_of(
    planes: Planes, view: int, rows: NDArray[np.intp], cols: NDArray[np.intp]
) -> NDArray[Any]:
    """Light within two pixels of places of a view.

    Parameters
    ----------
    planes
        What tells the light.
    view
        Which view of it.
    rows, cols
        (place,) at least two pixels from the edge.

    Returns
    -------
    around
        (place, 5, 5, primary).
    """
    return np.stack(planes(view, *_near(rows, cols)), axis=-1)


def around_of_plane(
    plane: NDArray[Any], rows: NDArray[np.intp], cols: NDArray[np.intp]
) -> NDArray[Any]:
    """`around_of` of one plane.

    Parameters
    ----------
    plane
        (row, col, ...).
    rows, cols
        (place,) at least two pixels from the edge.

    Returns
    -------
    around
        (place, 5, 5, ...).
    """
    return np.asarray(plane[_near(rows, cols)])


def _near(
    rows: NDArray[np.intp], cols: NDArray[np.intp]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """(place, 5, 1) rows and (place, 1, 5) columns within two pixels of places."""
    steps = np.arange(-2, 3)
    return rows[:, None, None] + steps[:, None], cols[:, None, None] + steps


def _light_of(near: NDArray[Any]) -> Floats:
    """Light of 3 x 3 pixels less what lies around, of (place, 5, 5)."""
    near = np.asarray(near, np.float64)
    around = near[:, _RING].mean(axis=1)
    return np.asarray(near[:, 1:-1, 1:-1].sum(axis=(1, 2)) - 9 * around)
