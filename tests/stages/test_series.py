"""What a session shows again and again is told from what only sets it up."""

from __future__ import annotations

import pytest

from ecat.stages.series import Series, sets_back, shown_family

RULES = Series(times=4, share=0.4, between=2)


@pytest.mark.parametrize(
    ("first", "second", "shown"),
    [("away", "toward", "leave"), ("toward", "away", "approach"), ("past", "away", "pass")],
)
def test_of_two_ways_that_alternate_the_first_is_shown(first: str, second: str, shown: str) -> None:
    assert shown_family([first, second] * 4, RULES) == shown


def test_the_more_frequent_way_is_shown_whatever_comes_first() -> None:
    assert shown_family(["away", *["past", "next", "away", "next"] * 3], RULES) == "approach"


def test_what_goes_no_way_has_no_say() -> None:
    assert shown_family(["away", "", "", "", "toward"] * 4, RULES) == "leave"


def test_too_few_are_no_series() -> None:
    assert shown_family(["away", "toward"] * 3, RULES) is None
    assert shown_family(["away", "toward"] * 4, RULES) == "leave"


def test_other_ways_on_end_are_no_setting_back() -> None:
    series = ["away", "toward"] * 5
    assert shown_family([*series, "past", "away"], RULES) == "leave"
    assert shown_family([*series, "past", "past", "away"], RULES) is None


def test_a_mixture_is_no_series() -> None:
    assert shown_family(["next", "past", "away", "toward", "around"] * 6, RULES) is None


def test_what_is_not_of_the_shown_family_sets_back() -> None:
    ways = ["next", "away", "toward", "", "next", "past", "next", "away"]
    assert sets_back(ways, RULES) == [False, True, False, True, False, True, False, True]


def test_without_a_series_nothing_sets_back() -> None:
    assert sets_back(["away", "toward", ""], RULES) == [False] * 3
    assert sets_back([], RULES) == []
