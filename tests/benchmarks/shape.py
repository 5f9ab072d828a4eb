"""How long is a shape measured, beside an identification of the same record in the same run?

    python tests/benchmarks/shape.py RIG RECORD

Times on a shared machine differ by factors; their ratio does not. No part of the tests. Without arguments the record is
that of a levitator with dry friction, which SciPy has integrated.
"""

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import ambid
from ambid.diagnosis import measured_shape
from hidden.one_axis import ONE_AXIS
from reference.friction_loop import record


def main() -> None:
    """Print both times, their ratio, and the shape."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rig", nargs="?")
    parser.add_argument("record", nargs="?")
    given = parser.parse_args()
    rig = ONE_AXIS.rig if given.rig is None else ambid.Rig.load(given.rig)
    i_e = ambid.prbs(8, amplitude=1.0, hold=4, periods=4)
    own = record(rig, i_e, 1) if given.record is None else ambid.Record.load(given.record, rig)
    begun = time.perf_counter()
    fit = ambid.identify(rig, own).comparison
    identified = time.perf_counter()
    shape = measured_shape(fit)
    done = time.perf_counter()
    ratio = (done - identified) / (identified - begun)
    print(f"identified in {identified - begun:.1f} s, shape in {done - identified:.1f} s: {ratio:.2f} times that")
    print(*(f"{at:12.4g} {value:12.4g}" for at, value in zip(shape.at, shape.values, strict=True)), sep="\n")


if __name__ == "__main__":
    main()
