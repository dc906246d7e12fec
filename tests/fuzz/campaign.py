"""Has targets fuzzed in a process beside this one, and collects what was found."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from select import select

ROOT = Path(__file__).parents[2]
_GRACE_SECONDS = 180


@dataclass(frozen=True)
class Case:
    """An input that breaks a reader, and how."""

    data: bytes
    told: str


@dataclass(frozen=True)
class Result:
    """Inputs tried, edges of the program covered, and the cases found."""

    runs: int
    covered: int
    cases: tuple[Case, ...]


class Fuzzer(AbstractContextManager["Fuzzer"]):
    """A process that has all readers instrumented, and fuzzes one target after the other."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.fuzz.worker"],
            cwd=ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.communicate()

    def fuzz(self, target: str, seconds: float) -> Result:
        """Fuzz one target in a process of its own."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with tempfile.TemporaryDirectory(prefix="ecat-fuzz-") as name:
            folder = Path(name)
            print(target, seconds, folder, file=self._process.stdin, flush=True)
            ready = select([self._process.stdout], [], [], seconds + _GRACE_SECONDS)[0]
            code = self._process.stdout.readline().strip() if ready else "no end"
            log = (folder / "log").read_text(errors="replace") if (folder / "log").exists() else ""
            cases = [*_findings(folder), *_deaths(folder, log)]
            if code != "0" and not cases:
                raise RuntimeError(f"the fuzzer of {target} failed ({code or 'it is gone'}):\n{log[-4000:]}")
            runs = re.findall(r"Done (\d+) runs", log)
            covered = re.findall(r"cov: (\d+)", log)
            return Result(int(runs[-1]) if runs else 0, int(covered[-1]) if covered else 0, tuple(cases))


def _findings(folder: Path) -> list[Case]:
    return [
        Case(path.read_bytes(), path.with_suffix(".txt").read_text())
        for path in sorted(folder.glob("finding-*"))
        if not path.suffix
    ]


def _deaths(folder: Path, log: str) -> list[Case]:
    """Inputs on which the process itself died, as libFuzzer left them."""
    paths = [path for kind in ("crash", "oom", "timeout") for path in sorted(folder.glob(f"{kind}-*"))]
    return [Case(path.read_bytes(), f"{path.name.partition('-')[0]}\n{log[-2000:]}") for path in paths]
