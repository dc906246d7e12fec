"""What a thread makes ahead of its use comes as it would have come without it."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import nullcontext

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.errors import FormatError
from ecat.store.media.ahead import AHEAD, ahead


@given(st.integers(0, 12), st.booleans())
def test_neither_order_nor_what_goes_wrong_changes(n: int, fails: bool) -> None:
    def items() -> Iterator[int]:
        yield from range(n)
        if fails:
            raise FormatError("cannot read it")

    seen: list[int] = []
    with pytest.raises(FormatError, match="cannot read it") if fails else nullcontext():
        seen.extend(ahead(items()))
    # what was read before something went wrong has been given out
    assert seen == list(range(n))


def test_few_are_made_ahead_and_none_once_nobody_wants_more() -> None:
    made: list[int] = []
    closed = threading.Event()

    def items() -> Iterator[int]:
        try:
            for i in range(100):
                made.append(i)
                yield i
        finally:
            closed.set()

    coming = ahead(items())
    assert [next(coming), next(coming)] == [0, 1]
    coming.close()
    assert closed.is_set()
    assert len(made) <= 2 + AHEAD
