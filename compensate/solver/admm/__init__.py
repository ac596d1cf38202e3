"""The solver of the paper's least squares: ADMM, certified.

`run` has the iteration; `pixels` its step in pixels, `hessian` its step in Fourier.
"""

from compensate.solver.admm.run import ADMM, require_certifiable

__all__ = ["ADMM", "require_certifiable"]
