"""What a finding is, how it is cut down to its smallest case, and where cases are kept."""

from __future__ import annotations

import hashlib
import signal
import time
import traceback
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from ecat.errors import EcatError
from tests.fuzz.targets import TARGETS

MAX_SECONDS = 2.0
"""Processor time that one input of at most 64 KiB may take."""
MAX_BYTES = 256 << 20
"""Growth of the process that one input may cause."""
REGRESSIONS = Path(__file__).parent / "corpus" / "regressions"


@dataclass(frozen=True)
class Finding:
    """A broken promise: ``key`` tells two apart, ``told`` is for people."""

    key: str
    told: str


class _TookTooLongError(BaseException):
    """Raised into a reader that does not end."""


@contextmanager
def _time_limit(seconds: float) -> Generator[None]:
    def stop(_signal: int, _frame: FrameType | None) -> None:
        raise _TookTooLongError

    before = signal.signal(signal.SIGVTALRM, stop)
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)


def check(target: str, data: bytes) -> Finding | None:
    """Run one input: a value or one `EcatError`, in bounded time and memory, or else a finding.

    Too slow must happen twice: the first time may pay for a late import or a busy machine.
    """
    finding = _run(target, data)
    return _run(target, data) if finding is not None and finding.key == "time" else finding


def _run(target: str, data: bytes) -> Finding | None:
    before, start = _peak_bytes(reset=True), time.process_time()
    try:
        with _time_limit(5 * MAX_SECONDS):
            TARGETS[target].run(data)
    except EcatError as error:
        if not error.what:
            return Finding("mute", f"{type(error).__name__} does not say what could not be done")
    except _TookTooLongError:
        return Finding("time", f"did not end in {5 * MAX_SECONDS} s")
    except Exception as error:  # noqa: BLE001  # any other exception is what we look for
        place = traceback.extract_tb(error.__traceback__)[-1]
        key = f"{type(error).__name__} at {Path(place.filename).name}:{place.name}"
        return Finding(key, "".join(traceback.format_exception(error)))
    seconds, grown = time.process_time() - start, _peak_bytes() - before
    if seconds > MAX_SECONDS:
        return Finding("time", f"{seconds:.1f} s for {len(data)} bytes")
    if grown > MAX_BYTES:
        return Finding("memory", f"{grown >> 20} MiB for {len(data)} bytes")
    return None


def _peak_bytes(*, reset: bool = False) -> int:
    """Largest resident size of the process since the last reset (Linux)."""
    if reset:
        Path("/proc/self/clear_refs").write_text("5")
    status = Path("/proc/self/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0]) * 1024


def minimise(target: str, data: bytes, finding: Finding, seconds: float = 10.0) -> bytes:
    """The smallest input with the same finding that removing pieces of halving size leads to."""
    deadline = time.monotonic() + seconds
    size = max(1, len(data) // 2)
    while time.monotonic() < deadline:
        start, smaller = 0, False
        while start < len(data) and time.monotonic() < deadline:
            candidate = data[:start] + data[start + size :]
            found = check(target, candidate)
            if found is not None and found.key == finding.key:
                data, smaller = candidate, True
            else:
                start += size
        if size == 1 and not smaller:
            break
        size = max(1, size // 2)
    return data


def store(target: str, data: bytes, folder: Path = REGRESSIONS) -> Path:
    """Keep a case; the suite replays it from then on."""
    path = folder / target / hashlib.sha256(data).hexdigest()[:16]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


def regressions() -> list[tuple[str, Path]]:
    """Every kept case with its target."""
    return sorted((path.parent.name, path) for path in REGRESSIONS.glob("*/*"))
