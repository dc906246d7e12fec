"""``python -m tests.fuzz [--seconds N] [TARGET ...]``: look for inputs that break a reader, and keep them.

Needs atheris. Each target runs in a process of its own; minimised cases go to
``tests/fuzz/corpus/regressions/TARGET/``, which the test suite replays. The exit code is 1 when something was
found.
"""

from __future__ import annotations

import argparse
import sys

from tests.fuzz.campaign import Fuzzer
from tests.fuzz.harness import store
from tests.fuzz.targets import TARGETS


def main() -> int:
    """Fuzz the chosen targets and print what was found."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description="Fuzz the readers.")
    parser.add_argument(
        "targets", nargs="*", metavar="TARGET", help=f"one of {', '.join(TARGETS)}; default: all"
    )
    parser.add_argument("--seconds", type=float, default=60.0, help="time for each target (default 60)")
    chosen = parser.parse_args()
    unknown = set(chosen.targets) - set(TARGETS)
    if unknown:
        parser.error(f"unknown target {', '.join(sorted(unknown))}")
    found = False
    with Fuzzer() as fuzzer:
        for target in chosen.targets or TARGETS:
            result = fuzzer.fuzz(target, chosen.seconds)
            print(
                f"{target}: {result.runs} inputs, {result.covered} edges, {len(result.cases)} findings",
                flush=True,
            )
            for case in result.cases:
                found = True
                print(f"\n{store(target, case.data)}\n{case.told}")
    return int(found)


if __name__ == "__main__":
    sys.exit(main())
