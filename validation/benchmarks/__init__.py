"""Cost of the solvers, in counts and in ratios measured in one run."""
