"""The product's solver of the paper's least squares: ADMM, certified.

`run` has the iteration; `level` what it does in pixels, `hessian` what it does in Fourier, `dome`
and `pair` what differs by what is observed. `loops` are the compiled ones, in place of strips of
NumPy; `fused` knows whether they are to be had.
"""

from compensate.solver.admm.planes import require_certifiable
from compensate.solver.admm.run import ADMM

__all__ = ["ADMM", "require_certifiable"]
