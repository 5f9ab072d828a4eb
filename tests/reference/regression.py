"""Local regressions one after the other, by dense least squares."""

import numpy as np

DEGREE, MOST_TAKEN = 2, 0.95


def left_beside(lines, excitation, weight, start, width):
    """What is left of lines, shape (width, p), and the part of each line's noise that was taken, shape (width,)."""
    own = slice(start, start + width)
    inputs = np.column_stack([excitation[own], np.ones(width)])
    x = np.linspace(-1.0, 1.0, width)
    table = np.column_stack([column * x**power * weight[own] for column in inputs.T for power in range(DEGREE + 1)])
    u, s, _ = np.linalg.svd(table, full_matrices=False)
    basis = u[:, s > 1e-13 * s[0]]
    taken = np.minimum(np.sum(np.abs(basis) ** 2, axis=1), MOST_TAKEN)
    return lines[own] - basis @ (basis.conj().T @ lines[own]), taken


def noise_beside(lines, excitation, weights, width, step):
    """S of every line, and the power of every line and channel; `weights` has those of y and of i_c."""
    count, p = lines.shape
    starts = [*range(0, count - width, step), count - width]
    middles = np.array(starts) + 0.5 * (width - 1)
    spectra, power = np.empty((count, p, p), dtype=complex), np.empty((count, p))
    for line in range(count):
        k = int(np.argmin(np.abs(middles - line)))  # of two as near the first
        parts = []
        for weight, channels in weights:
            left, taken = left_beside(lines[:, channels], excitation, weight, starts[k], width)
            place = line - starts[k]
            power[line, channels] = np.abs(left[place]) ** 2 / (1.0 - taken[place])
            parts.append(left)
        whole = np.hstack(parts)
        spectra[line] = whole.T @ whole.conj()
    return spectra, power
