"""Bearing reactions by hand: a static load in both directions of both planes, carried by two magnets."""

import numpy as np

UP_AND_DOWN = np.concatenate([np.linspace(0, 1500, 7), np.linspace(1250, 0, 6)])
CROSS = np.concatenate([np.outer(UP_AND_DOWN, direction) for direction in ((1, 0), (0, 1), (-1, 0), (0, -1))])


def reactions(rig, force, z):
    """Force of each magnet of two bearings, by the lever rule, resolved along the axes."""
    a, b = rig.bearings
    on_b = -force * ((z - a.position) / (b.position - a.position))[:, None]
    columns = []
    for one, on_one in ((a, -force - on_b), (b, on_b)):
        t = np.deg2rad(one.tilt)
        columns += [on_one @ [np.cos(t), np.sin(t)], on_one @ [-np.sin(t), np.cos(t)]]
    return np.stack(columns, axis=1)
