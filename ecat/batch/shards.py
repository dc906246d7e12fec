"""A share of the sessions, for one of several machines that do not know of each other."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

from ecat.errors import UsageError

_T = TypeVar("_T")
_MOST = 1_000_000


@dataclass(frozen=True, slots=True)
class Shard:
    """The ``index``-th of ``count`` shares, counted from one."""

    index: int
    count: int

    def of(self, items: Sequence[_T]) -> list[_T]:
        """Every ``count``-th, so that neighbours, which are alike, are shared out evenly."""
        return list(items[self.index - 1 :: self.count])

    def __str__(self) -> str:
        return f"{self.index}/{self.count}"


def parse_shard(text: str) -> Shard:
    """``2/8`` is the second of eight.

    Raises
    ------
    UsageError : anything else.
    """
    match = re.fullmatch(r"([0-9]{1,9})/([0-9]{1,9})", text.strip())
    shard = Shard(int(match[1]), int(match[2])) if match else None
    if shard is None or not 1 <= shard.index <= shard.count <= _MOST:
        raise UsageError(
            f"cannot understand --shard {text}",
            where="expected i/n, the i-th of n shares, with 1 <= i <= n",
            fix="--shard 1/8 for the first of eight, up to --shard 8/8; an array job that counts from 0 adds 1",
        )
    return shard
