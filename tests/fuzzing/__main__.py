"""Read many damaged files, more than the tests do, or repeat one of them.

python -m tests.fuzzing --seed 1 --count 20000 [--kinds csv,hdf5]
python -m tests.fuzzing --seed 1 --kinds csv --number 826 --keep damaged.csv
"""

import argparse
import sys
import time
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

from app.telemetry.formats import FORMATS
from tests.fuzzing.campaign import Outcome, replayed, run
from tests.fuzzing.damage import damaged
from tests.fuzzing.seeds import paths_of, write_seeds


def main() -> int:
    """Return 1 where a file was neither read nor refused as it should be."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzzing")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=10_000, help="files of each kind")
    parser.add_argument("--kinds", default=",".join(FORMATS))
    parser.add_argument("--number", type=int, help="only this file, of one kind")
    parser.add_argument("--keep", type=Path, help="where this file is left")
    given = parser.parse_args()
    failed = False
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "seeds").mkdir()
        seeds = write_seeds(folder / "seeds")
        for kind in given.kinds.split(","):
            paths = paths_of(seeds, kind)
            if given.number is not None:
                file = damaged(given.seed, kind, given.number, paths)
                (given.keep or folder / "file").write_bytes(file.content)
                print(f"{file.name}: {len(file.content)} bytes, {file.done}")
                print(replayed(file, folder))
                continue
            begun = time.monotonic()
            outcomes = run(given.seed, {kind: given.count}, seeds, folder)
            took = time.monotonic() - begun
            failed |= report(kind, outcomes, took, [str(path) for path in paths])
    return int(failed)


def report(kind: str, outcomes: list[Outcome], took: float, paths: list[str]) -> bool:
    """Print what came of the files of a kind; whether any is wrong."""
    ended = [outcome for outcome in outcomes if not outcome.contained]
    slowest = max(ended, key=lambda outcome: outcome.seconds)
    print(
        f"{kind}: {len(outcomes)} files from {len(paths)} in {took:.0f} s, "
        f"{dict(Counter(outcome.end for outcome in outcomes))}; slowest {slowest.seconds:.2f} s "
        f"(number {slowest.number}), most memory {max(outcome.memory for outcome in outcomes)} MiB",
        flush=True,
    )
    for outcome in outcomes:
        if outcome.end not in ("read", "refused"):
            print(f"  number {outcome.number} {outcome.end}: {outcome.text}")
    return any(outcome.end == "wrong" for outcome in outcomes)


if __name__ == "__main__":
    sys.exit(main())
