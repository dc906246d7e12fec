"""What a format can be told, from texts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.errors import UsageError
from ecat.formats import registry
from ecat.formats.options import NoOptions, describe, option, read_options


@dataclass(frozen=True, slots=True, kw_only=True)
class Some:
    fps: int = option(30, "images per second", least=1, most=1000)
    scale: float = option(1.0, "how large", least=0)
    layer: str = option("", "whose annotation")
    depth: bool = option(True, "with depth")
    clock: Literal["nearest", "before"] = option("nearest", "which image counts")
    limit: int | None = option(None, "at most so many")


def test_what_is_not_given_is_the_default() -> None:
    assert read_options(Some, {}, "x") == Some()
    assert read_options(NoOptions, {}, "x") == NoOptions()


def test_every_kind_of_value_is_read() -> None:
    texts = {
        "fps": "15",
        "scale": "0.5",
        "layer": "ann",
        "depth": "no",
        "clock": "before",
        "limit": "7",
    }
    assert read_options(Some, texts, "x") == Some(
        fps=15, scale=0.5, layer="ann", depth=False, clock="before", limit=7
    )
    assert read_options(Some, {"limit": ""}, "x").limit is None


@pytest.mark.parametrize(
    ("name", "text", "where"),
    [
        ("fps", "0", "fps: expected a whole number from 1 to 1000"),
        ("fps", "1001", "fps: expected a whole number from 1 to 1000"),
        ("fps", "15.5", "fps: expected a whole number from 1 to 1000"),
        ("fps", "", "fps: expected a whole number from 1 to 1000"),
        ("scale", "nan", "scale: expected a number from 0"),
        ("scale", "inf", "scale: expected a number from 0"),
        ("depth", "maybe", "depth: expected true, false"),
        ("clock", "after", "clock: expected nearest, before"),
        ("limit", "x", "limit: expected a whole number, or nothing"),
    ],
)
def test_a_value_that_cannot_be_says_what_can(name: str, text: str, where: str) -> None:
    with pytest.raises(UsageError, match=f"x cannot be told {name}={text}") as caught:
        read_options(Some, {name: text}, "x")
    assert caught.value.where == where


def test_an_unknown_option_names_the_nearest() -> None:
    with pytest.raises(UsageError, match="x has no option 'clok'") as caught:
        read_options(Some, {"clok": "nearest"}, "x")
    assert caught.value.fix == "did you mean clock?"
    with pytest.raises(UsageError) as caught:
        read_options(NoOptions, {"fps": "1"}, "x")
    assert caught.value.where == "its options are: none"


@given(st.dictionaries(st.sampled_from(["fps", "scale", "depth", "clock", "limit"]), st.text(max_size=8)))
def test_any_text_gives_options_or_one_error(texts: dict[str, str]) -> None:
    try:
        read = read_options(Some, texts, "x")
    except UsageError as error:
        assert error.where  # noqa: PT017  (either way is right)
    else:
        assert 1 <= read.fps <= 1000


def test_options_are_explained() -> None:
    explained = {known.name: known for known in describe(Some)}
    assert (explained["fps"].values, explained["fps"].default) == ("a whole number from 1 to 1000", "30")
    assert explained["depth"].default == "true"
    assert explained["limit"].values.endswith("or nothing")


def test_every_option_of_every_format_has_help_and_a_default_that_it_accepts() -> None:
    for known in registry.all_formats():
        for explained in describe(known.options):
            assert explained.help, f"{known.name}: {explained.name}"
            read_options(known.options, {explained.name: explained.default}, known.name)
