"""Generated pictures of what planetariums and 3D cinemas show.

They are inputs for experiments on quality, and stand in for real shows, which nobody may copy.
All are linear Light, float32, in 0..1. The same name gives the same picture at every size.

    texture         noise, stars, text and outlines, which all pictures are made of
    portrait        a face, for films
    dome            the canvas of a domemaster
    domes           domemasters; those of `chess`, `constellations` and `sights` are among them
    charts          domemasters in which a fault can be told
    stage           the canvas of a pair
    stereo          pairs; those of `street`, `landscapes`, `orbit` and `evening` are among them
"""

from testing.content.charts import BALLS, CHARTS
from testing.content.domes import DOMES as SHOWN
from testing.content.stereo import PAIRS

DOMES = {**SHOWN, **CHARTS}
"""Name -> the size of a domemaster -> the domemaster."""

__all__ = ["BALLS", "DOMES", "PAIRS"]
