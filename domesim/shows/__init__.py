"""Whole shows: every frame is done once, on one machine or many, and no result is lost.

`work` is what is done to one frame, `job` what is kept of it, `alone` and `cluster` who does it,
and `run` what commands call.
"""
