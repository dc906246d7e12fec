"""How long ``ecat --help`` takes, beside an interpreter that does nothing: ``python benchmarks/startup.py``.

Shell completion starts the program at every press of the key, so the aim is 0.3 s.  On a machine that is busy
with other work, the ratio to the bare interpreter says more than the time.
"""

from __future__ import annotations

import subprocess
import sys
import time

COMMANDS = {
    "python -c pass": ["-c", "pass"],
    "import ecat": ["-c", "import ecat"],
    "import ecat.cli": ["-c", "import ecat.cli"],
    "ecat --help": ["-c", "from ecat.cli import main; main()", "--help"],
}


def best_s(arguments: list[str], repeats: int = 7) -> float:
    """Shortest wall time of the interpreter with ``arguments``, in seconds: noise only ever adds."""
    times: list[float] = []
    for _ in range(repeats):
        start = time.perf_counter()
        subprocess.run([sys.executable, *arguments], check=True, capture_output=True)
        times.append(time.perf_counter() - start)
    return min(times)


def main() -> None:
    """Print one line per command."""
    bare = best_s(COMMANDS["python -c pass"])
    for name, arguments in COMMANDS.items():
        seconds = best_s(arguments)
        print(f"{name:<16} {seconds:6.3f} s  {seconds / bare:5.1f} x python -c pass")


if __name__ == "__main__":
    main()
