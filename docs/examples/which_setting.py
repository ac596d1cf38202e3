"""
Which setting for my content
============================

Kinds of picture in a giant dome and on a 3D screen, as the audience sees them: untouched, by plain
subtraction (``--lift 0``), half as much as by default (``--lift 0.5``), by default (``--lift 1``),
and twice as much (``--lift 2``).

- **A dark scene with something in the dark** (night sky, nebula, deep sea, a planet's night side):
  keep the default. ``--lift 2`` has more contrast in the dark, and a black that is nearer to that
  of the untouched picture, but never brighter.
- **Lit things on pure black** (titles, a window with a film): in a dome the settings hardly differ,
  and ``--lift 0`` has the deepest black. On a 3D screen take ``--lift 0.5`` or 0 if the veils that
  hide the edges of ghosts are seen.
- **A scene without black** (street, daylight, snow): subtraction is exact, and all settings are
  alike.
- **Flashes, and cuts from dark to bright**: a flash lifts the dark rest of a dome by at most the
  light that it adds there untouched. ``--lift 0`` takes away what can be taken.

*Lost* is what is lost of the picture's quality by ColorVideoVDP, in just-objectionable differences
(JOD): 0 is the master, and below 0.02 JOD there is no difference. ColorVideoVDP hardly sees that
black is brighter. *Black* tells it: the light of the darker half over the untouched one's. Look at
the pictures, and then at your screen: ``domesim compare`` makes such a page of your frames.

``python docs/examples/which_setting.py [SIZE]`` makes the pictures.
"""

import sys
from importlib import resources

import numpy as np

from domesim import load_master, load_scene
from testing.content import DOMES, PAIRS
from validation.settings import show_settings

size = int(sys.argv[1]) if len(sys.argv) > 1 else 384

# %%
# A giant dome
# ------------
# Two stops brighter than they are.
dome = load_scene("dome_imax")
with resources.as_file(resources.files("scenes") / "masters" / "night.exr") as path:
    night, _ = load_master(path, dome)
nearest = np.linspace(0, night.shape[1] - 1, size).round().astype(int)
pictures = {"night": night[:, nearest][:, :, nearest]}
for name in ("planetary limb", "underwater", "text and credits"):
    pictures[name] = DOMES[name](size)
show_settings(pictures, dome)

# %%
# A 3D screen
# -----------
# The left eye's pictures, at the crosstalk of a silver screen.
cinema = load_scene("stereo_cinema_silver")
show_settings({name: PAIRS[name](size) for name in ("snow", "credits", "space")}, cinema)
