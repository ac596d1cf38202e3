"""Solvers: one algorithm a file, all called as ``solver(problem, start) -> Result``."""
