"""Where the records of `hidden.null_cells` were before."""

from hidden.null_cells import described, made

__all__ = ["described", "made"]
