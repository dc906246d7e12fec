"""Neural recognisers: trained on a few scenes, kept, read again, and refused where they do not fit."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecat.errors import CorruptError, InputError, NotFoundError
from learn.features.points import SWAP_POINTS
from learn.features.windows import mirror
from learn.recognize.dataset import LabelledSession, exchanged, places_of, read_exports
from learn.recognize.inputs import SHAPES, Fitted
from learn.recognize.neural.recognizer import FEATURES, RECIPES, Trained, train
from learn.recognize.runs import Recognizer, load, save
from tests.learn.recognize import made

SMALL = {"epochs": 2, "hidden": 8}


@pytest.fixture(scope="module")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> list[LabelledSession]:
    return read_exports(made.exports(tmp_path_factory.mktemp("exports")))


@pytest.fixture(scope="module")
def neural(sessions: list[LabelledSession]) -> Trained:
    return train(
        sessions, replace(RECIPES["neural"], epochs=14, hidden=24, batch=16, rate=6e-3, keep=0.9, step=3)
    )


def points_of(sessions: list[LabelledSession]) -> list[Any]:
    return [session.points for session in sessions]


def test_a_network_learns_scenes_from_raw_points(neural: Trained, sessions: list[LabelledSession]) -> None:
    found = neural.recognizer.recognize(points_of(sessions))
    true = np.concatenate([session.labels for session in sessions])
    assert (found.labels(found.alone) == true).all(axis=1).mean() > 0.5
    np.testing.assert_allclose(found.context.sum(axis=1), 1)


def test_exchanged_boxes_exchange_what_is_said(neural: Trained, sessions: list[LabelledSession]) -> None:
    one = neural.recognizer.recognize(points_of(sessions[:2]))
    other = neural.recognizer.recognize([points[:, SWAP_POINTS] for points in points_of(sessions[:2])])
    order = places_of(exchanged(one.vocabulary), one.vocabulary)
    np.testing.assert_allclose(other.alone, one.alone[:, order], atol=1e-5)


def test_both_sides_of_a_mirror_are_half_of_what_is_said_each(
    neural: Trained, sessions: list[LabelledSession]
) -> None:
    """In haste either member of two sees one side; of a scene and its mirror image, both see both."""
    points = points_of(sessions[:2])
    parts = [
        neural.recognizer.alone(seen, thorough=False) for seen in (points, [mirror(one) for one in points])
    ]
    np.testing.assert_allclose(np.mean(parts, axis=0), neural.recognizer.alone(points), atol=1e-5)
    assert np.abs(parts[0] - parts[1]).max() > 1e-4


@pytest.mark.parametrize("name", list(FEATURES))
def test_every_model_is_kept_and_read_again(
    name: str, sessions: list[LabelledSession], tmp_path: Path
) -> None:
    recognizer = train(sessions, replace(RECIPES[name], **SMALL)).recognizer
    save(recognizer, tmp_path)
    again: Any = load(tmp_path)
    assert again.settings == recognizer.settings
    one, other = (each.recognize(points_of(sessions[:2])) for each in (recognizer, again))
    np.testing.assert_array_equal(one.alone, other.alone)
    np.testing.assert_array_equal(one.context, other.context)
    np.testing.assert_allclose(one.alone.sum(axis=1), 1, rtol=1e-5)


def test_states_that_are_carried_do_not_reach_the_next_sessions(sessions: list[LabelledSession]) -> None:
    recipe = replace(RECIPES["qual-lstm-crf"], carries=True, validation=0, batch=20, **SMALL)
    recognizer = train(sessions, recipe).recognizer
    one, other = (recognizer.recognize(points_of(sessions[:3])) for _ in range(2))
    np.testing.assert_array_equal(one.alone, other.alone)


def test_no_sessions_are_no_windows(neural: Trained) -> None:
    assert neural.recognizer.recognize([]).alone.shape[0] == 0


def test_validation_sets_sessions_of_every_file_aside(sessions: list[LabelledSession]) -> None:
    found = train(sessions, replace(RECIPES["mlp"], validation=0.4, patience=1, **SMALL))
    assert sorted(file for file, _ in found.validation) == ["pullpast"] * 2 + ["pushto"] * 2
    assert len(found.history.scores) == len(found.history.losses)


def test_sessions_without_a_window_teach_nothing_and_are_not_set_aside(
    sessions: list[LabelledSession],
) -> None:
    short = [
        replace(one, file=f"short{n}", points=one.points[:n], labels=one.labels[:0])
        for n, one in zip((0, 1, 19), sessions, strict=False)
    ]
    recipe = replace(RECIPES["neural"], validation=0.01, **SMALL)
    found = train([*short, *sessions], recipe)
    assert {file for file, _ in found.validation} <= {one.file for one in sessions}
    weights = [list(one.recognizer.network.state_dict().values()) for one in (found, train(sessions, recipe))]
    assert all(bool((a == b).all()) for a, b in zip(*weights, strict=True))


def test_nothing_to_learn_from_is_refused() -> None:
    with pytest.raises(InputError, match="cannot train"):
        train([], RECIPES["mlp"])


@pytest.mark.parametrize("name", list(SHAPES))
def test_inputs_have_the_shape_that_is_said(name: str, sessions: list[LabelledSession]) -> None:
    fitted = Fitted.of(name, points_of(sessions))
    gap = sessions[0].points.copy()
    gap[3, 14] = np.nan
    assert fitted.windows(gap).shape == (len(sessions[0].labels), *SHAPES[name])
    assert np.isfinite(fitted.windows(gap)).all()
    assert len(fitted.windows(gap, 1)) == 5 * len(sessions[0].labels) - 4


def test_a_joint_that_was_never_seen_is_one_error_for_the_features_of_the_thesis(
    sessions: list[LabelledSession],
) -> None:
    points = sessions[0].points.copy()
    points[:, 5] = np.nan
    with pytest.raises(InputError, match="cannot compute the features"):
        Fitted.of("ch4-pcas18", points_of(sessions)).windows(points)


@pytest.fixture
def run(neural: Trained, tmp_path: Path) -> Path:
    kept: Recognizer = neural.recognizer
    save(kept, tmp_path)
    return tmp_path


def changed(run: Path, **values: Any) -> None:
    config = json.loads((run / "config.json").read_text("utf-8"))
    (run / "config.json").write_text(json.dumps(config | values), "utf-8")


def test_a_model_of_other_features_is_refused_by_name(run: Path) -> None:
    changed(run, features="raw-0")
    with pytest.raises(InputError, match="cannot use") as error:
        load(run)
    assert "raw-0" in str(error.value)


def test_a_model_of_another_kind_is_refused_by_name(run: Path) -> None:
    changed(run, model="oracle")
    with pytest.raises(InputError, match="cannot use") as error:
        load(run)
    assert "oracle" in str(error.value)


@pytest.mark.parametrize(
    "values",
    [
        {"settings": {}},
        {"settings": 3},
        {"settings": {"model": "neural", "durations": 3}},
        {"vocabulary": [[9, 9, 9, 9, 9]]},
        {"vocabulary": "no"},
        {"habits": {"none": 1}},
        {"model": "hmm"},
        {"fit": [1, "x"]},
    ],
)
def test_a_damaged_config_is_one_error(values: dict[str, Any], run: Path) -> None:
    changed(run, **values)
    with pytest.raises((CorruptError, InputError)):
        load(run)


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04", b"\x80\x04K\x01."])
def test_a_damaged_network_is_one_error(damage: bytes, run: Path) -> None:
    (run / "network.npz").write_bytes(damage)
    with pytest.raises(CorruptError):
        load(run)


def test_no_model_is_missed(tmp_path: Path) -> None:
    with pytest.raises(NotFoundError):
        load(tmp_path)
