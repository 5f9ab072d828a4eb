"""The closed loop as a linear fractional transformation: plant, effects and controller, compiled for the core."""
