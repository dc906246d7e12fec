"""Ratings in a table, the survey of thesis §5.3.5 among them."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from ecat.annotate.agreement import Columns, rated_figures, ratings_text
from ecat.errors import FormatError

RATINGS = pd.DataFrame(
    {
        "clip": ["a", "a", "b", "b", "c", "c"],
        "judge": ["ann", "ben"] * 3,
        "answer": ["Past", "Past", "Next", "Away", "Next", ""],
        "truth": ["Past", "Past", "Next", "Next", "Next", "Next"],
    }
)


def test_columns_are_found_by_their_usual_names() -> None:
    found = rated_figures(RATINGS)
    assert (found["items"], found["raters"], found["blank"]) == (3, 2, 1)
    assert found["raters_names"] == ["ann", "ben"]
    assert found["observed"] == 0.5
    assert found["confusion"]["accuracy"] == 0.8
    assert "1 ratings are blank" in ratings_text(found)


def test_an_empty_answer_may_stand_for_one() -> None:
    found = rated_figures(RATINGS, blank="None")
    assert found["blank"] == 0
    assert found["observed"] == pytest.approx(1 / 3, abs=1e-5)
    assert "None" in found["confusion"]["labels"]


def test_scores_are_numbers_if_they_are_said_to_be() -> None:
    scores = RATINGS.assign(answer=["9", "8", "2", "3", "5", "5"]).drop(columns="truth")
    assert rated_figures(scores, level="interval")["krippendorff_alpha"] > 0.9
    assert rated_figures(scores)["krippendorff_alpha"] < 0.5


@pytest.mark.parametrize(
    ("ratings", "why"),
    [
        (RATINGS.rename(columns={"clip": "thing"}), "item is not clear"),
        (pd.concat([RATINGS, RATINGS]), "more than one answer"),
        (RATINGS[[]], "not clear"),
    ],
)
def test_a_table_that_is_none_of_ratings_is_refused(ratings: pd.DataFrame, why: str) -> None:
    with pytest.raises(FormatError, match=r"cannot compare") as caught:
        rated_figures(ratings)
    assert why in caught.value.where


def test_a_named_column_must_be_there() -> None:
    with pytest.raises(FormatError):
        rated_figures(RATINGS, Columns(rater="who"))
    with pytest.raises(FormatError):
        rated_figures(RATINGS, Columns(truth="right"))


def test_words_are_no_interval_scale() -> None:
    with pytest.raises(FormatError, match="cannot compare the ratings"):
        rated_figures(RATINGS, level="interval")


def test_the_thesis_survey_gives_its_kappa_and_its_confusion(shared: Path) -> None:
    answers = pd.read_csv(shared / "demonstrations_ch5/survey_3d/answers.csv", dtype="string")
    found = rated_figures(answers, blank="None")
    assert (found["items"], found["raters"]) == (150, 5)
    assert found["fleiss_kappa"] == 0.50874
    # figure 5.26
    assert found["confusion"]["labels"] == ["Around", "Away", "Closer", "Next", "None", "Past"]
    shares = dict(zip(found["confusion"]["labels"], found["confusion"]["shares"], strict=True))
    assert shares["Next"] == pytest.approx([0.03, 0.0, 0.41, 0.35, 0.14, 0.07], abs=5e-3)
    assert shares["Closer"][3] == pytest.approx(0.21, abs=5e-3)
    assert found["confusion"]["accuracy"] == pytest.approx(0.609, abs=5e-4)
