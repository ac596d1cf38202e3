"""What tests and experiments share: generated pictures, theatres, photographs, dense matrices.

Tests of `domesim` and `compensate` import this package, and never `validation`, which imports it.
"""
