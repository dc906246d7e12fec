"""Shares of the sessions."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.batch import Shard, parse_shard
from ecat.errors import UsageError


@given(st.integers(1, 40), st.integers(0, 100))
def test_every_item_is_in_exactly_one_share(count: int, n: int) -> None:
    shares = [Shard(index, count).of(range(n)) for index in range(1, count + 1)]
    assert sorted(item for share in shares for item in share) == list(range(n))
    assert max(map(len, shares)) - min(map(len, shares)) <= 1


def test_a_share_is_written_as_it_is_read() -> None:
    assert parse_shard("2/8") == Shard(2, 8)
    assert str(parse_shard(" 2/8 ")) == "2/8"


@pytest.mark.parametrize(
    "text", ["", "2", "0/8", "9/8", "2/0", "-1/8", "1/8/2", "a/b", "1.5/2", "1/9999999999"]
)
def test_anything_else_says_what_is_expected(text: str) -> None:
    with pytest.raises(UsageError, match="cannot understand --shard") as caught:
        parse_shard(text)
    assert "expected i/n" in caught.value.where


@given(st.text(max_size=12))
def test_any_text_is_a_share_or_one_error(text: str) -> None:
    try:
        shard = parse_shard(text)
    except UsageError:
        return
    assert 1 <= shard.index <= shard.count
