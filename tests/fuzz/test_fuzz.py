"""No input breaks a reader: kept cases, seeds, mutations, and a short coverage-guided search."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.fuzz import harness
from tests.fuzz.campaign import Fuzzer
from tests.fuzz.harness import Finding, check, minimise, regressions, store
from tests.fuzz.targets import TARGETS, Target

SECONDS = 2.0


@st.composite
def mutated(draw: st.DrawFn, seeds: tuple[bytes, ...]) -> bytes:
    """A seed with pieces cut, repeated, overwritten or inserted."""
    data = bytearray(draw(st.sampled_from(seeds)))
    for _ in range(draw(st.integers(0, 6))):
        start = draw(st.integers(0, len(data)))
        end = draw(st.integers(start, min(len(data), start + 40)))
        data[start:end] = draw(
            st.binary(max_size=8)
            | st.just(bytes(data[start:end]) * 3)
            | st.sampled_from([b"", b"<", b"-1", b"1e999", b"\x00", b"<a>", b"</a>", "∞".encode(), b"&#x41;"])
        )
    return bytes(data)


@pytest.mark.parametrize(
    ("target", "path"), regressions(), ids=lambda value: str(getattr(value, "name", value))
)
def test_kept_cases_stay_fixed(target: str, path: Path) -> None:
    assert check(target, path.read_bytes()) is None


@pytest.mark.parametrize("target", TARGETS)
def test_seeds_are_read(target: str) -> None:
    for seed in TARGETS[target].seeds:
        TARGETS[target].run(seed)


@pytest.mark.parametrize("target", TARGETS)
def test_any_mutation_gives_a_value_or_one_typed_error(target: str) -> None:
    @settings(max_examples=60, deadline=None)
    @given(mutated(TARGETS[target].seeds))
    def mutation(data: bytes) -> None:
        assert check(target, data) is None

    mutation()


@pytest.fixture(scope="module")
def fuzzer() -> Generator[Fuzzer]:
    pytest.importorskip("atheris")
    with Fuzzer() as made:
        yield made


@pytest.mark.slow
@pytest.mark.parametrize("target", TARGETS)
def test_a_short_search_finds_nothing(fuzzer: Fuzzer, target: str) -> None:
    result = fuzzer.fuzz(target, SECONDS)
    assert result.runs > 0
    assert not result.cases, "\n".join(case.told for case in result.cases)


class TestTheHarness:
    """The search itself works: planted faults are found, cut down and kept."""

    @pytest.fixture(autouse=True)
    def planted(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def run(data: bytes) -> None:
            if b"bad" in data:
                raise KeyError("planted")
            if b"slow" in data:
                while True:
                    pass
            if b"big" in data:
                bytearray(400 << 20)

        monkeypatch.setitem(TARGETS, "planted", Target(run, ()))

    def test_a_foreign_exception_is_a_finding_and_is_cut_down(self) -> None:
        data = b"x" * 500 + b"bad" + b"y" * 700
        finding = check("planted", data)
        assert finding is not None
        assert finding.key == "KeyError at test_fuzz.py:run"
        assert minimise("planted", data, finding) == b"bad"

    def test_a_reader_without_end_is_stopped_and_found(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(harness, "MAX_SECONDS", 0.05)
        assert check("planted", b"slow") == Finding("time", "did not end in 0.25 s")

    def test_unbounded_memory_is_found(self) -> None:
        finding = check("planted", b"big")
        assert finding is not None
        assert finding.key == "memory"

    def test_what_behaves_is_no_finding(self) -> None:
        assert check("planted", b"good") is None

    def test_kept_cases_are_replayed(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(harness, "REGRESSIONS", tmp_path)
        path = store("planted", b"bad", tmp_path)
        assert regressions() == [("planted", path)]
        assert path.read_bytes() == b"bad"
