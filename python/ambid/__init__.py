"""ambid: parameters of active magnetic bearings from the machine's own closed loop."""
