"""A night at the observatory: a small domemaster that the project renders itself.

Bright windows, lamps and a moon stand next to lawns, trees and hills at a fraction of a per cent of
white: the dark detail that cross-reflection destroys in a dome. Everything is made by code, from a
seed. `picture` looks at the `scene` (the `observatory` in its `garden`) and puts it before the
`sky`; `python -m scenes.artwork.night` writes the file.
"""
