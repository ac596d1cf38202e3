"""An orrery in a dark hall: animated masters that the project renders itself, mono and stereo.

A lamp, planets and polished rails stand next to iron and stone at a fraction of a per cent of
white: what cross-reflection in a dome and crosstalk in stereo destroy. Everything is made by code,
from a seed and a time. `orrery` says what turns where; `hall`, `surfaces` and `sky` are what stands
still; `stage` makes Mitsuba's scene of them, `cameras` look at it, `picture` develops the frames,
and `command` writes them.
"""
