"""When two simulations are the same."""

import numpy as np


def require_equal(found, expected):
    """To 1e-12 of the largest value of each output."""
    assert found.shape == expected.shape
    assert (np.abs(found - expected).max(axis=0) <= 1e-12 * np.abs(expected).max(axis=0)).all()
