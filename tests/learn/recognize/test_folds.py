"""Folds: a fifth of each file, always the same."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from learn.recognize.folds import FILE, folds_of, make_folds, write_folds

KEYS = [(file, f"{file}{number}") for file in ("rollto", "pullfrom") for number in range(1, 31)]


def test_each_fold_has_a_fifth_of_each_file() -> None:
    folds = make_folds(KEYS)
    for kind in ("random", "blocks"):
        counts = Counter((key[0], fold[kind]) for key, fold in folds.items())
        assert set(counts.values()) == {6}


def test_blocks_are_contiguous_numbers() -> None:
    folds = make_folds(KEYS)
    assert [folds["rollto", f"rollto{number}"]["blocks"] for number in (1, 6, 7, 12, 13, 30)] == [
        0,
        0,
        1,
        1,
        2,
        4,
    ]


def test_the_file_that_is_kept_is_what_the_function_makes(tmp_path: Path) -> None:
    keys = [(line.split(",")[0], line.split(",")[1]) for line in FILE.read_text("utf-8").splitlines()[1:]]
    write_folds(make_folds(keys), tmp_path / "folds.csv")
    assert (tmp_path / "folds.csv").read_bytes() == FILE.read_bytes()


def test_sessions_that_are_not_in_the_file_have_a_fold_of_their_own() -> None:
    keys = [("new", str(number)) for number in range(200)]
    folds = folds_of(keys, "random").tolist()
    assert set(folds) == {0, 1, 2, 3, 4}
    assert folds == folds_of(keys[::-1], "blocks").tolist()[::-1]
