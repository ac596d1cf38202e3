"""Whether loops are compiled by Numba, and how it is set for all of them.

With the extra ``fast`` they are; ``DOMESIM_FAST=0`` in the environment leaves them out.
"""

from __future__ import annotations

import importlib.util
import os

from domesim.light.strips import threads

_SETTINGS = {
    # Threads that wait for others in a busy loop made a solution ten times slower while other
    # programs ran, and are no faster while none do
    "OMP_WAIT_POLICY": "PASSIVE",
    # TBB's layer keeps 7 kB of memory at each call of a loop, and is slower the more it has kept
    # (numba 0.68, tbb 2023.2): a show has millions of calls
    "NUMBA_THREADING_LAYER_PRIORITY": "omp tbb workqueue",
}


def compiles() -> bool:
    """Says whether loops are compiled, and tells Numba how, without importing it."""
    if os.environ.get("DOMESIM_FAST", "1") == "0" or importlib.util.find_spec("numba") is None:
        return False
    # Numba's own setting is for one thread of ours only
    os.environ.setdefault("NUMBA_NUM_THREADS", str(threads()))
    for name, value in _SETTINGS.items():
        os.environ.setdefault(name, value)
    return True
