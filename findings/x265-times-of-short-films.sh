#!/usr/bin/env bash
# x265 4.2 in PyAV 18.1.0's wheel (FFmpeg 8.1): films of one or two frames, with two B-frames allowed.
#
# Guessed: the time at which a film's only frame is decoded (DTS) is 0, or the time it is shown, at
#          each run; and if a muxer refuses such a film, then always.
# Seen:    the DTS is whatever the memory held before: mostly 0, now and then a number of 16 digits,
#          or below 0. Then Matroska's muxer says "Invalid argument", MP4's "Not yet implemented",
#          or the film is written with that time, without a word. From three frames on it is right.
#
# Why: x265 tells times of decoding once it has as many frames as B-frames delay it. Where the film
# ends before that, FFmpeg is handed a picture whose DTS nobody has set.
# It was met as a test that failed now and then in whole runs on a busy machine, never by itself.
# glibc's MALLOC_PERTURB_ fills new memory with a byte of one's choice, which makes it certain.
# What to do: bframes=0 for a film that may be that short (a still as HEVC), or libx264, which is right.
#
# Needs: Linux with glibc, Python 3.11 or later, and network. Fails if the behaviour changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q av==18.1.0
cat >"$folder/times.py" <<'P'
import os
from fractions import Fraction

import av

for codec, bframes, count in (
    ("libx265", 2, 1), ("libx265", 2, 2), ("libx265", 2, 3), ("libx265", 0, 1), ("libx264", 2, 1)
):
    quiet = ":pools=1:frame-threads=1:log-level=none" if codec == "libx265" else ""
    context = av.CodecContext.create(codec, "w")
    context.width, context.height, context.pix_fmt = 128, 96, "yuv420p"
    context.framerate, context.time_base = 24, Fraction(1, 24)
    context.options = {codec[3:] + "-params": f"bframes={bframes}{quiet}"}
    packets = []
    for number in range(count):
        frame = av.VideoFrame(128, 96, "yuv420p")
        for plane in frame.planes:
            plane.update(bytes(plane.buffer_size))
        frame.pts, frame.time_base = number, Fraction(1, 24)
        packets += context.encode(frame)
    packets += context.encode(None)
    memory = int(os.environ.get("MALLOC_PERTURB_", "0"))
    set_by_nobody = int.from_bytes(bytes([memory]) * 8, "little", signed=True)
    times = ", ".join(
        "what memory held" if memory and abs(packet.dts - set_by_nobody) < 9 else str(packet.dts)
        for packet in packets
    )
    print(f"{codec}, {bframes} B-frames, {count} in all: {times}")
P
export MALLOC_PERTURB_=7
seen=$("$folder/env/bin/python" "$folder/times.py")
echo "$seen"
diff <(echo "$seen") - <<'E2'
libx265, 2 B-frames, 1 in all: what memory held
libx265, 2 B-frames, 2 in all: what memory held, what memory held
libx265, 2 B-frames, 3 in all: -2, -1, 0
libx265, 0 B-frames, 1 in all: 0
libx264, 2 B-frames, 1 in all: 0
E2
