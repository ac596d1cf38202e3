"""A study with an audience: pairs of pictures, forced choices, and what they show.

`design` says who sees what in which order, `stimuli` makes the pictures, `folder` writes all that
is played and printed, `playing` serves it to a browser and keeps the answers, `files` reads them.
`inference`, `viewers` and `analysis` say what they show, `power` says how many viewers are enough,
and `rehearsal` has viewers who are simulated.
"""
