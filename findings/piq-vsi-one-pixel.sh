#!/usr/bin/env bash
# piq 0.8.0: VSI of two pictures that differ in one pixel of 65,536, by a tenth of an 8-bit code.
#
# Guessed: 1 to five digits, as nothing else of the two differs.
# Seen:    1.00000 for a change of 0.001 codes, 0.98934 for one of 0.1 codes, and the same for more.
#
# Why: VSI weighs pixels by a saliency whose colour term is 1 - exp(-(a² + b²) / 0.001²), of a* and
# b* that are stretched to the least and the greatest of the picture. It is 0 in what has the least
# a* and b* of all, here the black border of a warm picture, and 1 in all else. One pixel that
# is bluer than black by a tenth of a code takes the border out of "the least of all".
# A picture that is black beside its screen (a dome's, a letterbox) is of this kind. With the
# rounding and dither of 8 bits in both pictures the step is gone.
#
# Needs: Python 3.11 or later, and network. Fails if the behaviour changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q numpy==2.4.6 torch==2.13.0
"$folder/env/bin/pip" install -q --no-deps piq==0.8.0
"$folder/env/bin/python" -W ignore - <<'P'
import sys
from unittest.mock import MagicMock

import numpy as np
import torch

# piq imports it for metrics by trained networks, which VSI is not
sys.modules |= {name: MagicMock() for name in ("torchvision", "torchvision.models", "torchvision.models.inception", "torchvision.models.resnet", "torchvision.transforms", "torchvision.datasets", "torchvision.datasets.utils")}
import piq  # noqa: E402

down, across = np.mgrid[:256, :256] / 256
glow = (np.exp(-((down - 0.9) ** 2) / 0.05) * 0.6 + 0.08) * (np.hypot(across - 0.5, down - 0.5) < 0.45)
warm = (glow[..., None] * [220, 150, 90]).astype(np.float32)  # black outside a disc
warm[100:110, 100:110] *= 3


def vsi(change):
    changed = warm.copy()
    changed[10, 10] = [0, change, change]
    pair = (torch.from_numpy(each.transpose(2, 0, 1)[None].copy()) for each in (changed, warm))
    return float(piq.vsi(*pair, data_range=255))


seen = {change: vsi(change) for change in (0.001, 0.1, 1.0)}
for change, figure in seen.items():
    print(f"one pixel of 65,536 changed by {change} codes: VSI {figure:.5f}")
assert seen[0.001] > 0.99999, seen
assert seen[0.1] < 0.99, seen
assert abs(seen[1.0] - seen[0.1]) < 0.001, seen
P
