"""What holds for all tests."""

from __future__ import annotations

import os

# Before NumPy loads: threads that wait for each other on busy cores make small matrices ten times
# slower.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
