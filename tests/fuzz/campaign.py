"""Runs the fuzzing process of one target and collects what it found."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
_GRACE_SECONDS = 60


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


def fuzz(target: str, seconds: float) -> Result:
    """Fuzz one target in a process of its own."""
    with tempfile.TemporaryDirectory(prefix="ecat-fuzz-") as name:
        folder = Path(name)
        process = subprocess.run(
            [sys.executable, "-m", "tests.fuzz.worker", target, str(seconds), name],
            cwd=ROOT,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=seconds + _GRACE_SECONDS,
            check=False,
        )
        cases = [*_findings(folder), *_deaths(folder, process.stderr)]
        if process.returncode and not cases:
            raise RuntimeError(f"the fuzzer of {target} failed:\n{process.stderr[-4000:]}")
        runs = re.findall(r"Done (\d+) runs", process.stderr)
        covered = re.findall(r"cov: (\d+)", process.stderr)
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
