"""Solvers, called as ``solver(problem, start) -> Result``: a module each, and `admm` a folder."""
