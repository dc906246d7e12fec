"""A recogniser knows what it was trained on, is read as it was written, and is refused when it was tampered with."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecat.errors import CorruptError, InputError
from learn.features.points import SWAP_POINTS
from learn.recognize.dataset import LabelledSession, exchanged, read_exports
from learn.recognize.evaluation import some_of, trained_on
from learn.recognize.model import Recognizer, Settings, load, save, train
from tests.learn.recognize import made

QUICK = Settings(n_trees=6, n_models=1)


@pytest.fixture(scope="module")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> list[LabelledSession]:
    return read_exports(made.exports(tmp_path_factory.mktemp("exports"), 4))


@pytest.fixture(scope="module")
def recognizer(sessions: list[LabelledSession]) -> Recognizer:
    return train(sessions[1:], QUICK)


def test_exchanged_boxes_are_recognised_as_that(
    recognizer: Recognizer, sessions: list[LabelledSession]
) -> None:
    points = [session.points for session in sessions]
    found = recognizer.recognize(points)
    other = recognizer.recognize([part[:, SWAP_POINTS] for part in points])
    np.testing.assert_array_equal(exchanged(found.labels(found.alone)), other.labels(other.alone))


def test_a_session_as_a_whole_tells_what_it_ends_with(
    recognizer: Recognizer, sessions: list[LabelledSession]
) -> None:
    seen = recognizer.seen([session.points for session in sessions])
    np.testing.assert_allclose(seen.sessions.sum(axis=1), 1)
    ends = recognizer.vocabulary[seen.sessions.argmax(axis=1)]
    assert ends[0].tolist() == sessions[0].labels[-1].tolist()  # of which nothing was learned


def test_sessions_that_are_shorter_than_a_window_are_passed_over(
    recognizer: Recognizer, sessions: list[LabelledSession]
) -> None:
    points = [session.points for session in sessions[:2]]
    found = recognizer.recognize([points[0], points[0][:19], points[1], points[1][:0]])
    np.testing.assert_array_equal(found.context, recognizer.recognize(points).context)


def test_it_knows_what_it_was_trained_on(recognizer: Recognizer, sessions: list[LabelledSession]) -> None:
    assert [one.key for one in trained_on(recognizer, sessions)] == [one.key for one in sessions[1:]]
    assert trained_on(object(), sessions) == []


def test_it_is_read_as_it_was_written(
    recognizer: Recognizer, sessions: list[LabelledSession], tmp_path: Path
) -> None:
    save(recognizer, tmp_path / "run")
    again = load(tmp_path / "run")
    points = [session.points for session in sessions]
    np.testing.assert_array_equal(again.recognize(points).context, recognizer.recognize(points).context)
    assert again.trained_on == recognizer.trained_on


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("vocabulary", [[0, 0, 0, 0, 0]]),
        ("trained_on", 3),
        ("habits", {"x": 1}),
        ("settings", {"n_trees": []}),
    ],
)
def test_a_config_of_another_model_is_refused(
    name: str, value: Any, recognizer: Recognizer, tmp_path: Path
) -> None:
    save(recognizer, tmp_path)
    config = json.loads((tmp_path / "config.json").read_text("utf-8"))
    (tmp_path / "config.json").write_text(json.dumps(config | {name: value}), "utf-8")
    if name == "settings":  # they are not used again
        load(tmp_path)
        return
    with pytest.raises(CorruptError):
        load(tmp_path)


@pytest.mark.parametrize("name", ["mover.left", "whole.relation.value", "arrival.value"])
def test_trees_that_are_missing_are_refused(name: str, recognizer: Recognizer, tmp_path: Path) -> None:
    save(recognizer, tmp_path)
    with np.load(tmp_path / "model.npz") as kept:
        arrays = {key: kept[key] for key in kept.files if key != name}
    np.savez(tmp_path / "model.npz", allow_pickle=False, **arrays)
    with pytest.raises(CorruptError):
        load(tmp_path)


def test_other_features_are_refused_by_name(recognizer: Recognizer, tmp_path: Path) -> None:
    save(recognizer, tmp_path)
    config = json.loads((tmp_path / "config.json").read_text("utf-8"))
    (tmp_path / "config.json").write_text(json.dumps(config | {"features": "windows-1"}), "utf-8")
    with pytest.raises(InputError, match="windows-1"):
        load(tmp_path)


def test_a_share_of_the_sessions_has_some_of_each_file(sessions: list[LabelledSession]) -> None:
    some = some_of(sessions, 0.5, seed=1)
    assert [one.file for one in some] == ["pullpast"] * 2 + ["pushto"] * 2
    assert some == some_of(sessions, 0.5, seed=1)
    assert some_of(sessions, 1.25, seed=1) == sessions
