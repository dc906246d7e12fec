"""Cross-validation of any model: fold by fold, kept, and in the order of the sessions."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecat.errors import CorruptError, ExistsError, InputError
from ecat.progress import Progress
from learn.recognize.crossval import (
    Split,
    cross_validate_model,
    in_order,
    kept_or,
    made_of,
    refuse_another,
    said_of,
    splits_of,
)
from learn.recognize.dataset import LabelledSession, read_exports
from learn.recognize.evaluation import Predicted
from learn.recognize.neural.recognizer import RECIPES
from learn.recognize.runs import Options, train
from tests.learn.recognize import made


@pytest.fixture(scope="module")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> list[LabelledSession]:
    return read_exports(made.exports(tmp_path_factory.mktemp("exports"), 12))


def oracle(split: Split, progress: Progress) -> Predicted:
    """Knows everything."""
    true = np.concatenate([session.labels for session in split[1]])
    sure = np.arange(len(true), dtype=np.float64)
    return Predicted(split[1], {"windows": true, "context": true * 0}, {"windows": sure, "context": sure / 2})


def test_folds_test_every_session_once_and_never_a_known_one(sessions: list[LabelledSession]) -> None:
    splits = splits_of(sessions, "random")
    tested = [session.key for _, part in splits for session in part]
    assert sorted(tested) == sorted(session.key for session in sessions)
    for known, part in splits:
        assert not {one.key for one in known} & {one.key for one in part}


def test_too_few_sessions_are_refused(sessions: list[LabelledSession]) -> None:
    with pytest.raises(InputError, match="cannot cross-validate"):
        splits_of(sessions[:2], "blocks")


def test_parts_come_back_in_the_order_of_the_sessions(sessions: list[LabelledSession]) -> None:
    parts = [oracle(([], sessions[5:]), lambda *_: None), oracle(([], sessions[:5]), lambda *_: None)]
    found = in_order(parts, sessions)
    np.testing.assert_array_equal(found.labels["windows"], found.true)
    assert found.probabilities["windows"][0] == 0
    n_late = sum(len(session.labels) for session in sessions[5:])
    assert found.probabilities["windows"][-1] == n_late - 1


def test_what_is_kept_is_not_computed_again_unless_it_is_of_something_else(
    sessions: list[LabelledSession], tmp_path: Path
) -> None:
    calls: list[int] = []

    def counting(split: Split, progress: Progress) -> Predicted:
        calls.append(1)
        return oracle(split, progress)

    split, keep = (sessions[3:], sessions[:3]), tmp_path / "fold.npz"
    first = kept_or(counting, split, keep, "a")
    again = kept_or(counting, split, keep, "a")
    assert len(calls) == 1
    for way in ("windows", "context"):
        np.testing.assert_array_equal(first.labels[way], again.labels[way])
        np.testing.assert_array_equal(first.probabilities[way], again.probabilities[way])
    kept_or(counting, split, keep, "b")
    kept_or(counting, (sessions[4:], sessions[:3]), keep, "b")
    keep.write_bytes(b"PK broken")
    kept_or(counting, (sessions[4:], sessions[:3]), keep, "b")
    assert len(calls) == 4


def test_a_model_is_scored_over_seeds(sessions: list[LabelledSession], tmp_path: Path) -> None:
    options = [Options(seed=0), Options(seed=1)]
    result, found = cross_validate_model(sessions, "lds", "random", options, keep=tmp_path)
    assert set(result["runs"]) == {"0", "1"}
    assert result["spread"] == {"windows": 0, "context": 0}
    assert result["mean"]["windows"] == result["runs"]["0"]["windows"]["tuple"] > 0.8
    assert len(found.true) == 24 * 6
    assert len(list(tmp_path.glob("lds-random-*.npz"))) == 10


def test_a_share_is_what_is_learned_from(
    sessions: list[LabelledSession], monkeypatch: pytest.MonkeyPatch
) -> None:
    known: list[int] = []

    def counted(name: str, some: list[LabelledSession], options: Options, **_: object) -> Any:
        known.append(len(some))
        return train("lds", some, options)

    monkeypatch.setattr("learn.recognize.crossval.train", counted)
    result, _ = cross_validate_model(sessions, "lds", "random", [Options()], share=0.25)
    assert result["share"] == 0.25
    assert 4 <= max(known) <= 8


def test_what_networks_learn_from_is_part_of_what_they_say_depends_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = made_of("mixture", Options(epochs=2))
    monkeypatch.setitem(RECIPES, "neural", replace(RECIPES["neural"], durations=(1.0,)))
    assert made_of("mixture", Options(epochs=2)) != before


@pytest.mark.parametrize(
    ("kept", "error", "words"),
    [
        (
            {"model": "trees", "folds": "random", "share": 1.0},
            ExistsError,
            "--model trees --folds random --share 1.0",
        ),
        (
            {"model": "lds", "folds": "random", "share": 1.0},
            ExistsError,
            "--model lds --folds random --share 1.0",
        ),
        ({"model": "trees", "share": 1.0}, CorruptError, "folds"),
        ({"model": "trees", "folds": "random", "share": 1.0, "options": 7}, CorruptError, "options"),
    ],
)
def test_figures_that_say_no_options_were_made_without_any(
    kept: dict[str, Any], error: type[Exception], words: str, tmp_path: Path
) -> None:
    (tmp_path / "crossval.json").write_text(json.dumps(kept), "utf-8")
    with pytest.raises(error) as caught:
        refuse_another(tmp_path, said_of("trees", "random", 1.0, Options(trees=5)))
    assert words in str(caught.value) or error is CorruptError
    assert "--trees" not in str(caught.value)
