"""`python -m tests.fuzzing --mutations 20000 [--reader NAME ...] [--seed N] [--start N]`."""

import argparse
import sys
import time

from tests.fuzzing.campaign import Fuzzer
from tests.fuzzing.targets import all_targets


def main() -> int:
    """Runs the mutants, prints a line for each reader and every defect; 1 where there is one."""
    names = list(all_targets())
    parser = argparse.ArgumentParser(prog="python -m tests.fuzzing", description=__doc__)
    parser.add_argument("--mutations", type=int, default=200, help="mutants of each reader (default 200)")
    parser.add_argument("--reader", action="append", choices=names, help="only this one; may be given again")
    parser.add_argument("--seed", type=int, default=0, help="the same seed gives the same mutants (default 0)")
    parser.add_argument("--start", type=int, default=0, help="the first mutant, such as one that a defect names")
    options = parser.parse_args()
    found = 0
    with Fuzzer() as fuzzer:
        for name in options.reader or names:
            begun = time.perf_counter()
            report = fuzzer.run(name, options.mutations, options.seed, options.start)
            print(f"{report} ({time.perf_counter() - begun:.0f} s in all)", flush=True)
            for index, detail in report.defects[:5]:
                print(f"  mutant {index}: {detail}", flush=True)
            found += len(report.defects)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
