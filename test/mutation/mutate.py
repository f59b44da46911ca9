"""`./run mutate engine [--sample N] [--seed S] [--nets explorer,unit,scenarios]`: mutants, and who notices them."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import List

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
sys.path[:0] = [str(HERE)]
for _name in ("hypothesis", "lz4.frame", "numpy", "pytest_benchmark.plugin", "rich.console", "rosbags.typesys", "yaml"):
    __import__(_name)  # once, for all the processes that begin as a copy of this one

from mutation_campaign import Campaign, Task  # noqa: E402
from mutation_code import places, sample  # noqa: E402
from mutation_mutant import NETS  # noqa: E402
from mutation_results import PAGE, RESULTS, results, summary, write  # noqa: E402


def main(arguments: List[str], root: Path = ROOT) -> int:
    """Run it; return 1 when a mutant survives all nets and is not waived, or a waiver is not needed any more."""
    options = _options(arguments)
    campaign = Campaign(root, root / "build" / "mutation", options.jobs)
    found = places(campaign.root)
    drawn = sample(found, options.sample, options.seed, campaign.root)
    print(f"{len(drawn)} mutants of {len(found)}, seed {options.seed}", flush=True)
    numbers = {mutant.key: number for number, mutant in enumerate(drawn, 1)}

    def tell(task: Task, caught_by: str) -> None:
        place = task.mutant.place
        words = f"{numbers[task.mutant.key]:4} {task.net:9} {place.path}:{place.line}"
        print(f"{words:70} {caught_by or 'SURVIVED'}", flush=True)

    try:
        campaign.run(drawn, options.nets, tell)
        told = results(campaign, drawn, len(found), options.seed, options.nets)
        print(summary(told, campaign.root))
        if options.write:
            write(told, root / RESULTS.relative_to(ROOT), root / PAGE.relative_to(ROOT))
    finally:
        campaign.close()
    return int(bool(told.survivors or told.not_needed))


def _options(arguments: List[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="./run mutate engine", description=__doc__)
    parser.add_argument("--sample", type=int, default=400, metavar="N", help="so many mutants (400)")
    parser.add_argument("--seed", type=int, default=1, metavar="S", help="which (1); more of one seed begin with fewer")
    parser.add_argument("--nets", type=_nets, default=NETS, help="explorer,unit,scenarios (all)")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="so many at a time (2)")
    parser.add_argument("--write", action="store_true", help="keep the result in test/mutation and docs/safety.md")
    return parser.parse_args(arguments)


def _nets(text: str) -> List[str]:
    names = text.split(",")
    unknown = [name for name in names if name not in NETS]
    if unknown:
        raise argparse.ArgumentTypeError(f"there is no net {unknown[0]!r}: {', '.join(NETS)}")
    return names


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
