"""Whole shows: each frame is done once, on this machine or on many, and nothing is lost.

`work` is what is done to one frame, `job` what is kept of it, `alone` and `cluster` who does it,
and `run` what commands call.
"""
