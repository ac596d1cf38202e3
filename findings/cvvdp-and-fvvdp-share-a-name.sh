#!/usr/bin/env bash
# cvvdp 0.5.7 and pyfvvdp 1.2.2, two judges of one laboratory, in one process.
#
# Guessed: both can be imported, in either order, as packages of different names.
# Seen:    pyfvvdp, then pycvvdp: ImportError (cannot import name 'interp1dim2' from 'interp').
#          pycvvdp, then pyfvvdp: no error, and pyfvvdp computes with pycvvdp's `interp`.
#
# Why: each puts its own folder on sys.path, and imports `interp` from there, as a top-level module.
# The two modules of that name differ; whichever came first is everybody's.
# What to do: import pyfvvdp with `interp` and `third_party` taken out of sys.modules, and
# pycvvdp's folder out of sys.path, and put them back afterwards.
#
# Needs: Python 3.11 or later, and network. Fails if the behaviour changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q torch==2.13.0 cvvdp==0.5.7 pyfvvdp==1.2.2

imports() {
    echo "$1, then $2:"
    "$folder/env/bin/python" -W ignore - "$@" <<'P'
import importlib
import sys
from pathlib import Path
from unittest.mock import MagicMock

# Imported for films and trained networks, which are not used here
parts = ("", ".models", ".ops", ".transforms", ".transforms.functional", ".io")
sys.modules |= {"torchvision" + part: MagicMock() for part in parts}
for name in sys.argv[1:]:
    try:
        importlib.import_module(name)
    except ImportError as error:
        print(f"    {name}: {type(error).__name__}: {str(error).partition(' (')[0]}")
    else:
        print(f"    {name}: its `interp` is {Path(sys.modules['interp'].__file__).parent.name}'s")
P
}
seen=$(imports pyfvvdp pycvvdp; imports pycvvdp pyfvvdp)
echo "$seen"
diff <(echo "$seen") - <<'E2'
pyfvvdp, then pycvvdp:
    pyfvvdp: its `interp` is pyfvvdp's
    pycvvdp: ImportError: cannot import name 'interp1dim2' from 'interp'
pycvvdp, then pyfvvdp:
    pycvvdp: its `interp` is pycvvdp's
    pyfvvdp: its `interp` is pycvvdp's
E2
