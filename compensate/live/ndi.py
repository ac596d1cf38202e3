"""Pictures by NDI: from another program, and on to others.

Pictures are UYVY, of 8 bits, BT.709 in limited range at every size, or UYVA, with an alpha. Other
layouts lose more: white of R, G, B comes back as 253, 253, 251. Colour differences lie in pairs of
columns, and rows of pictures in pairs too, so that sides are even.

The runtime is the one that the package cyndilib brings. Its own classes are not used (0.1.3): its
receiver starts a frame synchroniser, which takes two frames of three away from it, and waits with
Python's lock held. Without them a call waits while other threads work.
"""

from __future__ import annotations

import ctypes
import importlib.util
import re
import threading
import time
from collections.abc import Callable, Iterator
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any, Self, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.frames import yuv
from domesim.light.strips import in_strips

_WAIT_MS = 200  # between looks at whether it is over
_GONE = 2.0  # seconds without a picture and without a sender
_NAMES = ("libndi.so*", "libndi.dylib", "Processing.NDI.Lib.x64.dll")
_UYVY, _UYVA = (int.from_bytes(code, "little") for code in (b"UYVY", b"UYVA"))
_VIDEO, _PROGRESSIVE, _HIGHEST, _FASTEST = 1, 1, 100, 100
_NOW = np.iinfo(np.int64).max  # a timecode that the runtime makes
_MATRIX = 1  # BT.709
_ADDRESS = re.compile(r"[\w.:-]+:\d+")


class _Source(ctypes.Structure):
    _fields_ = (("name", ctypes.c_char_p), ("url", ctypes.c_char_p))


class _Finding(ctypes.Structure):
    _fields_ = (
        ("show_local", ctypes.c_bool),
        ("groups", ctypes.c_char_p),
        ("extra_ips", ctypes.c_char_p),
    )


class _Receiving(ctypes.Structure):
    _fields_ = (
        ("source", _Source),
        ("color_format", ctypes.c_int),
        ("bandwidth", ctypes.c_int),
        ("allow_fields", ctypes.c_bool),
        ("name", ctypes.c_char_p),
    )


class _Sending(ctypes.Structure):
    _fields_ = (
        ("name", ctypes.c_char_p),
        ("groups", ctypes.c_char_p),
        ("clock_video", ctypes.c_bool),
        ("clock_audio", ctypes.c_bool),
    )


class _Video(ctypes.Structure):
    _fields_ = (
        ("cols", ctypes.c_int),
        ("rows", ctypes.c_int),
        ("fourcc", ctypes.c_uint32),
        ("rate_numerator", ctypes.c_int),
        ("rate_denominator", ctypes.c_int),
        ("aspect", ctypes.c_float),
        ("fields", ctypes.c_int),
        ("timecode", ctypes.c_int64),
        ("data", ctypes.POINTER(ctypes.c_uint8)),
        ("stride", ctypes.c_int),
        ("metadata", ctypes.c_char_p),
        ("timestamp", ctypes.c_int64),
    )


@cache
def _runtime() -> Any:
    """NDI's library.

    Raises
    ------
    InputError
        If there is none.
    """
    package = importlib.util.find_spec("cyndilib")
    if package is None or package.origin is None:
        raise InputError("live: NDI needs the extra 'ndi': pip install 'domesim[ndi]'")
    folder = Path(package.origin).parent
    found = sorted(path for name in _NAMES for path in folder.rglob(name) if path.stat().st_size)
    for path in found:
        try:
            library = ctypes.CDLL(str(path))
        except OSError:  # of another machine
            continue
        for name in ("find_create_v2", "find_get_current_sources", "recv_create_v3", "send_create"):
            getattr(library, f"NDIlib_{name}").restype = ctypes.c_void_p
        return library
    raise InputError(f"live: wanted NDI's library for this machine in {folder}, got none")


@final
class Receiver:
    """A program's pictures, as they come; it is waited for, and again whenever it goes away.

    Parameters
    ----------
    name
        As other programs list it, ``COMPUTER (NAME)``, or its NAME alone; or where it is, as
        ``ADDRESS:PORT``, which finds sources that no list has.
    over
        Set when no more are wanted.
    tell
        Called with what a person should know.

    Attributes
    ----------
    shape
        Rows and cols of the pictures.
    alpha
        Whether they have one.
    rate
        Pictures a second, as the sender says.

    Raises
    ------
    InputError
        If there is no library.
    """

    def __init__(self, name: str, over: threading.Event, tell: Callable[[str], None]) -> None:
        self._name, self._over, self._tell = name, over, tell
        self._library = _runtime()
        settings = _Receiving(_Source(), _FASTEST, _HIGHEST, True, b"domesim")
        self._receiver = ctypes.c_void_p(
            self._library.NDIlib_recv_create_v3(ctypes.byref(settings))
        )
        self.shape, self.alpha, self.rate = (0, 0), False, Fraction(0)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._library.NDIlib_recv_destroy(self._receiver)

    def connect(self) -> bool:
        """Waits for the source, and for its first picture; False if it is over before.

        Raises
        ------
        InputError
            As for `pictures`.
        """
        if not self._connected():
            return False
        return next(self._pictures(peek=True), None) is not None

    def pictures(self) -> Iterator[NDArray[np.uint16]]:
        """Yields (row, col, channel) R, G, B code values of 16 bits, and alpha if there is one.

        Raises
        ------
        InputError
            If they are not whole, have odd sides, or change their size or alpha.
        """
        return self._pictures(peek=False)

    def _pictures(self, *, peek: bool) -> Iterator[Any]:
        library, video, last = self._library, _Video(), time.monotonic()
        while not self._over.is_set():
            kind = library.NDIlib_recv_capture_v3(
                self._receiver, ctypes.byref(video), None, None, _WAIT_MS
            )
            if kind == _VIDEO:
                last = time.monotonic()
                try:
                    self._look(video)
                    picture = None if peek else self._decoded(video)
                finally:
                    library.NDIlib_recv_free_video_v2(self._receiver, ctypes.byref(video))
                yield picture if picture is not None else self.shape
            elif time.monotonic() - last > _GONE:
                if not library.NDIlib_recv_get_no_connections(self._receiver):
                    self._tell(f"NDI source {self._name} has gone; it is waited for")
                    if not self._connected():
                        return
                last = time.monotonic()

    def _connected(self) -> bool:
        """Looks for the source until it is there; False if it is over before."""
        library, count, told = self._library, ctypes.c_uint32(), False
        if _ADDRESS.fullmatch(self._name):
            there = _Source(None, self._name.encode())
            library.NDIlib_recv_connect(self._receiver, ctypes.byref(there))
            return True
        settings = _Finding(True, None, None)
        finder = ctypes.c_void_p(library.NDIlib_find_create_v2(ctypes.byref(settings)))
        try:
            while not self._over.is_set():
                place = library.NDIlib_find_get_current_sources(finder, ctypes.byref(count))
                sources = ctypes.cast(place, ctypes.POINTER(_Source))
                for source in (sources[k] for k in range(count.value)):
                    name = source.name.decode("utf-8", "replace")
                    if name == self._name or name.endswith(f" ({self._name})"):
                        library.NDIlib_recv_connect(self._receiver, ctypes.byref(source))
                        return True
                if not told:
                    self._tell(f"waiting for NDI source {self._name}")
                told = True
                library.NDIlib_find_wait_for_sources(finder, _WAIT_MS)
        finally:
            library.NDIlib_find_destroy(finder)
        return False

    def _look(self, video: _Video) -> None:
        """Learns what pictures are like, and refuses others."""
        if video.fourcc not in (_UYVY, _UYVA) or video.fields != _PROGRESSIVE:
            raise InputError(
                f"NDI source {self._name}: wanted whole pictures of UYVY, got "
                f"{'fields' if video.fields != _PROGRESSIVE else 'another layout'}; let it send "
                f"progressive video"
            )
        shape, alpha = (video.rows, video.cols), video.fourcc == _UYVA
        if not self.rate:
            require_even(*shape)
            self.shape, self.alpha = shape, alpha
        if (shape, alpha) != (self.shape, self.alpha):
            raise InputError(
                f"NDI source {self._name}: wanted pictures of {self.shape[1]} x {self.shape[0]} "
                f"{'with' if self.alpha else 'without'} alpha, as before, got {shape[1]} x "
                f"{shape[0]} {'with' if alpha else 'without'}; start again"
            )
        self.rate = Fraction(video.rate_numerator or 1, video.rate_denominator or 1)

    def _decoded(self, video: _Video) -> NDArray[np.uint16]:
        rows, cols = self.shape
        size = rows * video.stride * (3 if self.alpha else 2) // 2
        lines = np.ctypeslib.as_array(video.data, (size,))
        packed = lines[: rows * video.stride].reshape(rows, -1)[:, : 2 * cols]
        alpha = None
        if self.alpha:
            alpha = lines[rows * video.stride :].reshape(rows, -1)[:, :cols]
        return decoded(packed, alpha)


@final
class Sender:
    """A source of pictures, which other programs list by its name.

    Parameters
    ----------
    name
        Its name.
    source
        Whose pictures' size, alpha and rate it has.

    Raises
    ------
    InputError
        If there is no library, or another source of this computer has that name.
    """

    def __init__(self, name: str, source: Receiver) -> None:
        self._library, self._source = _runtime(), source
        settings = _Sending(name.encode(), None, False, False)
        sender = self._library.NDIlib_send_create(ctypes.byref(settings))
        if not sender:
            raise InputError(
                f"--ndi-out {name}: wanted a new name, got one that another source of this "
                f"computer has; choose another"
            )
        self._sender = ctypes.c_void_p(sender)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._library.NDIlib_send_destroy(self._sender)

    def send(self, picture: NDArray[np.uint8]) -> None:
        """Sends what `encoded` makes."""
        rows, cols = self._source.shape
        video = _Video(
            cols,
            rows,
            _UYVA if self._source.alpha else _UYVY,
            self._source.rate.numerator,
            self._source.rate.denominator,
            0.0,
            _PROGRESSIVE,
            _NOW,
            picture.ctypes.data_as(ctypes.POINTER(ctypes.c_uint8)),
            2 * cols,
            None,
            0,
        )
        self._library.NDIlib_send_send_video_v2(self._sender, ctypes.byref(video))


def require_even(rows: int, cols: int) -> None:
    """Refuses odd sides, of which NDI loses a line.

    Raises
    ------
    InputError
        If one is odd.
    """
    if rows % 2 or cols % 2:
        raise InputError(f"NDI: wanted pictures of even sides, got {cols} x {rows}; scale them")


def decoded(
    packed: NDArray[np.uint8], alpha: NDArray[np.uint8] | None = None
) -> NDArray[np.uint16]:
    """Code values of a picture.

    Parameters
    ----------
    packed
        (row, 2 col): C_B, Y, C_R, Y of each two columns, in limited range.
    alpha
        (row, col), if there is one.

    Returns
    -------
    pixels
        (row, col, channel) R, G, B of 16 bits, and alpha if there is one.
    """
    rows, cols = packed.shape[0], packed.shape[1] // 2
    pixels = np.empty((rows, cols, 3 if alpha is None else 4), np.uint16)

    def decode(_: int, some: slice) -> None:
        values = packed[some].astype(np.float32)
        luma = (values[:, 1::2] - 16) / np.float32(219)
        blue, red = (
            yuv.full_size((values[:, at::4] - 128) / np.float32(224), "4:2:2", luma.shape)
            for at in (0, 2)
        )
        pixels[some, :, :3] = np.rint(yuv.from_luma(luma, blue, red, _MATRIX) * 65535)
        if alpha is not None:
            pixels[some, :, 3] = alpha[some] * np.uint16(257)

    in_strips(decode, (1, rows, cols, 3))
    return pixels


def encoded(pixels: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """The picture of code values: the inverse of `decoded`, as far as its 8 bits tell.

    Parameters
    ----------
    pixels
        As `decoded` returns it.

    Returns
    -------
    picture
        (byte,) of all rows, then of alpha's if there is one.
    """
    rows, cols, channels = pixels.shape
    picture = np.empty(rows * cols * (3 if channels > 3 else 2), np.uint8)
    packed = picture[: 2 * rows * cols].reshape(rows, 2 * cols)

    def encode(_: int, some: slice) -> None:
        values = pixels[some, :, :3].astype(np.float32) / np.float32(65535)
        luma, *differences = yuv.limited_codes(values, _MATRIX, 8)
        packed[some, 1::2] = np.rint(luma)
        for at, plane in zip((0, 2), differences, strict=True):
            packed[some, at::4] = np.rint(yuv.small_size(plane, "4:2:2"))
        if channels > 3:
            picture[2 * rows * cols :].reshape(rows, cols)[some] = pixels[some, :, 3] >> 8

    in_strips(encode, (1, rows, cols, 3))
    return picture
