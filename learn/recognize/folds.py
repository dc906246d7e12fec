"""Which sessions are tested together, written down once and kept, so that figures can be compared."""

from __future__ import annotations

import csv
import hashlib
import re
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ecat.store import staged_file

N_FOLDS = 5
Kind = Literal["random", "blocks"]
FILE = Path(__file__).with_name("folds.csv")

Key = tuple[str, str]


def make_folds(keys: Sequence[Key], *, seed: int = 0) -> dict[Key, dict[Kind, int]]:
    """Two folds for each session (file, name), both with a fifth of every file.

    ``random`` deals a file's sessions out as they come from a shuffle; ``blocks`` cuts them, ordered by the number in
    their names, in five, so that what was recorded in one go is tested together.
    """
    generator = np.random.default_rng(seed)
    found: dict[Key, dict[Kind, int]] = {}
    dealt = 0
    for file in sorted({file for file, _ in keys}):
        mine = sorted((key for key in keys if key[0] == file), key=lambda key: (_number(key[1]), key[1]))
        for place, key in enumerate(mine):
            found[key] = {"random": 0, "blocks": place * N_FOLDS // len(mine)}
        for place in generator.permutation(len(mine)).tolist():
            found[mine[place]]["random"] = dealt % N_FOLDS
            dealt += 1
    return found


def write_folds(folds: Mapping[Key, Mapping[Kind, int]], dest: Path) -> None:
    """A CSV with the columns file, session, random, blocks.

    Raises
    ------
    ExistsError : there is something already.
    """
    with staged_file(dest) as staging, staging.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["file", "session", "random", "blocks"])
        writer.writerows([*key, fold["random"], fold["blocks"]] for key, fold in folds.items())


def folds_of(keys: Sequence[Key], kind: Kind) -> NDArray[np.int64]:
    """The fold of each session: the one that is written down, or else one by the hash of its file and name."""
    kept = _kept()
    return np.array([kept[key][kind] if key in kept else _hashed(key) for key in keys], np.int64)


@cache
def _kept() -> dict[Key, dict[Kind, int]]:
    with FILE.open(encoding="utf-8", newline="") as stream:
        return {
            (row["file"], row["session"]): {"random": int(row["random"]), "blocks": int(row["blocks"])}
            for row in csv.DictReader(stream)
        }


def _hashed(key: Key) -> int:
    return hashlib.sha256("\0".join(key).encode()).digest()[0] % N_FOLDS


def _number(name: str) -> int:
    digits = re.search(r"\d+$", name)
    return int(digits[0]) if digits else 0
