"""Experiments: one file a claim, each with its rationale, what is expected, and a `run`."""
