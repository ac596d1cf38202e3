"""Generated pictures of what planetariums and 3D cinemas show.

They are inputs for experiments on quality, and stand in for real shows, which nobody may copy.
All are linear Light, float32, in 0..1. The same name gives the same picture at every size.

    texture         noise, stars, text and outlines, which all pictures are made of
    portrait        a face, for films
    dome            the canvas of a domemaster
    domes           nine domemasters; `chess` and `constellations` are two of them
    stage           the canvas of a pair
    stereo          six pairs; `street`, `landscapes` and `orbit` hold four of them
"""

from validation.content.domes import DOMES
from validation.content.stereo import PAIRS

__all__ = ["DOMES", "PAIRS"]
