"""Fixtures shared by every test."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest
from hypothesis import settings

# a slow disk or a busy machine is no fault of what is tested
settings.register_profile("ecat", deadline=None)
settings.load_profile("ecat")
# a shell starts what it puts in the background deaf to Ctrl-C, and so would be all programs that tests interrupt
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

SHARED = Path(__file__).resolve().parents[2] / "shared"


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of real reference data beside the checkout; tests that need it skip where it is missing."""
    if not (SHARED / "data").is_dir():
        pytest.skip("the reference data (../shared) is not beside this checkout")
    return SHARED / "data"


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--update-golden` accepts what the code writes now as the expected output."""
    parser.addoption("--update-golden", action="store_true", help="rewrite tests/golden and sample_sessions")


class Golden:
    """Compares texts with the files in tests/golden, or rewrites them."""

    def __init__(self, folder: Path, *, update: bool) -> None:
        self._folder = folder
        self.update = update

    def check(self, name: str, text: str) -> None:
        """Fail if `text` is not what tests/golden/`name` holds."""
        path = self._folder / name
        if self.update:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        assert path.is_file(), f"no golden file {name}: look at what is written, then `make golden`"
        assert text == path.read_text(encoding="utf-8"), (
            f"tests/golden/{name}: if the change is meant, `make golden`"
        )


@pytest.fixture(scope="session")
def golden(pytestconfig: pytest.Config) -> Golden:
    """The expected outputs."""
    return Golden(Path(__file__).parent / "golden", update=bool(pytestconfig.getoption("--update-golden")))
