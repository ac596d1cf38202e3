#!/usr/bin/env bash
# cyndilib 0.1.3 (NDI runtime 6.3.2): 60 pictures sent at 30 a second, received by `Receiver.receive`.
#
# Guessed: all of them come, perhaps late.
# Seen:    16 to 30 come. NDI's own count (`get_performance_data`) is of 60, none dropped.
#
# Why: `Receiver` always makes a frame synchroniser of the same NDI receiver, and its attribute
# `frame_sync` does not take it away again. NDI's synchroniser fetches pictures for itself, and
# what it has fetched `receive` does not see.
# What to do: read by the frame synchroniser, at the rate that you want; or call the runtime that the
# wheel brings by ctypes (NDIlib_recv_capture_v3), which loses none.
#
# Needs: Linux with user namespaces, iproute2, Python 3.11 or later, and network to install. Sender
# and receiver then run in a namespace that has loopback only. Fails if the behaviour changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q cyndilib==0.1.3 numpy==2.4.6
echo '{"ndi":{"networks":{"ips":"127.0.0.1"}}}' > "$folder/ndi-config.v1.json"
export NDI_CONFIG_DIR=$folder
cat > "$folder/send.py" <<'P'
import time
from fractions import Fraction

import numpy as np
from cyndilib.sender import Sender
from cyndilib.video_frame import VideoSendFrame
from cyndilib.wrapper import FourCC

frame = VideoSendFrame()
frame.set_resolution(256, 256)
frame.set_frame_rate(Fraction(30))
frame.set_fourcc(FourCC.UYVY)
sender = Sender("numbers", clock_video=True)
sender.set_video_frame(frame)
with sender:
    while sender.get_num_connections(0) == 0:
        time.sleep(0.02)
    time.sleep(0.5)
    for number in range(60):
        sender.write_video(np.full(256 * 256 * 2, 64 + number, np.uint8))
    time.sleep(1)
P
cat > "$folder/receive.py" <<'P'
import subprocess
import sys
import time

import numpy as np
from cyndilib.finder import Finder
from cyndilib.receiver import ReceiveFrameType, Receiver
from cyndilib.video_frame import VideoRecvFrame
from cyndilib.wrapper import RecvBandwidth, RecvColorFormat

sending = subprocess.Popen([sys.executable, sys.argv[1]])
finder = Finder()
finder.open()
source = None
while source is None:
    time.sleep(0.05)
    finder.update_sources()
    for name in finder.get_source_names():
        if name.endswith("(numbers)"):
            source = finder.get_source(name)
receiver = Receiver(color_format=RecvColorFormat.fastest, bandwidth=RecvBandwidth.highest)
frame = VideoRecvFrame()
receiver.set_video_frame(frame)
receiver.set_source(source)
count = 0
while sending.poll() is None:
    if receiver.receive(ReceiveFrameType.recv_video, 100) & ReceiveFrameType.recv_video:
        frame.fill_p_data(np.empty(frame.get_buffer_size(), np.uint8))
        count += 1
print(f"{count} of 60 came, {receiver.get_performance_data()['video']['frames_dropped']} dropped")
sys.exit(not 10 <= count <= 45)
P
unshare -rn sh -c "ip link set lo up && '$folder/env/bin/python' '$folder/receive.py' '$folder/send.py'"
