"""The sound of one video, copied into another as it is."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any, Self, final

_QUICKTIME = ("aac", "alac", "mp3", "ac3", "eac3")


@final
class Sound:
    """The sound of a video on its way into another one.

    Parameters
    ----------
    source
        The video that has it; None for silence.
    container
        PyAV's, which gets it.
    rate
        Rate of its frames, a second: sound of another rate is left out.
    """

    def __init__(self, source: Path | None, container: Any, rate: Fraction) -> None:
        self._source, self._into, self._rate = source, container, rate
        self._from: Any = None
        self._streams: dict[int, Any] = {}  # by index in the source
        self._packets: Iterator[Any] = iter(())
        self._next: Any = None
        self._start = Fraction(0)  # of the picture, which begins at 0 in the other video

    def __enter__(self) -> Self:
        """Open the source."""
        import av  # noqa: PLC0415

        if self._source is not None:
            self._from = av.open(f"file:{self._source}", metadata_errors="replace")
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        if self._from is not None:
            self._from.close()

    def begin(self) -> list[str]:
        """Announce what is to come; what the container cannot hold is returned, for a person."""
        if self._from is None:
            return []
        picture = self._from.streams.video[0]
        if self._from.streams.audio and picture.guessed_rate != self._rate:
            return ["without its sound, which is of another rate"]
        self._start = Fraction((picture.start_time or 0) * picture.time_base)
        lacking = []
        for old in self._from.streams.audio:
            name = old.codec_context.codec.canonical_name
            if not self._holds(name):
                lacking.append(f"without its sound in {name}, which the file cannot hold")
                continue
            self._streams[old.index] = self._into.add_stream_from_template(old)
        wanted = [self._from.streams[index] for index in self._streams]
        if wanted:
            self._packets = self._from.demux(*wanted)
            self._advance()
        return lacking

    def _holds(self, codec: str) -> bool:
        """Whether the container takes it; of QuickTime FFmpeg says so of what it then refuses."""
        if self._into.format.name == "mov":
            return codec.startswith("pcm_") or codec in _QUICKTIME
        return codec in self._into.supported_codecs

    def copy(self, until: Fraction | None) -> None:
        """Copy what belongs before `until`, seconds from the first frame; or all that is left."""
        while self._next is not None:
            shift = round(self._start / self._next.time_base)
            at = (self._next.dts - shift) * self._next.time_base
            if until is not None and at > until:
                return
            self._next.pts, self._next.dts = self._next.pts - shift, self._next.dts - shift
            self._next.stream = self._streams[self._next.stream.index]
            self._into.mux(self._next)
            self._advance()

    def _advance(self) -> None:
        self._next = next((each for each in self._packets if each.dts is not None), None)
