"""After an ambiguous verdict: the proposed experiment, made on the independent simulator, names the truth alone.

python tests/benchmarks/next_experiment.py 10    each case with 10 seeds: what is proposed, and what both records name
"""

import sys
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from hidden.next_experiments import CASES, is_truth_alone, run


def main(seeds):
    for case in CASES:
        proposed, ends, ambiguous, alone = Counter(), Counter(), 0, 0
        for seed in range(seeds):
            before, best, after = run(case, seed)
            if best is None:
                ends[f"not ambiguous: {before.verdict} {', '.join(before.effects)}"] += 1
                continue
            ambiguous += 1
            alone += is_truth_alone(case, after)
            proposed[f"{best.change.what}, {best.seconds:.2g} s"] += 1
            if not is_truth_alone(case, after):
                ends[f"{after.verdict} {after.effects} {after.ambiguous_sets}"] += 1
        print(f"{case}\n  ambiguous {ambiguous} of {seeds}; with the proposed one the truth alone is named in {alone}")
        print("  proposed:", "; ".join(f"{what} ({count})" for what, count in proposed.most_common()))
        for end, count in ends.items():
            print(f"  otherwise: {end} ({count})", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]))
