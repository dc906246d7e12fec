"""Trees and a network together."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecat.errors import CorruptError
from learn.recognize.dataset import LabelledSession, read_exports
from learn.recognize.mixture import LEAST
from learn.recognize.runs import Options, load, save, train
from tests.learn.recognize import made

pytest.importorskip("torch", reason="PyTorch is not installed: pip install 'ecat[learn]'")
SMALL = Options(trees=4, epochs=1, hidden=8)


@pytest.fixture(scope="module")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> list[LabelledSession]:
    return read_exports(made.exports(tmp_path_factory.mktemp("exports"), 3))


@pytest.fixture(scope="module")
def run(sessions: list[LabelledSession], tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("run")
    save(train("mixture", sessions, SMALL)[0], found)
    return found


def test_it_says_the_geometric_mean_of_what_its_parts_say(run: Path, sessions: list[LabelledSession]) -> None:
    points = [session.points for session in sessions]
    both, trees = (load(folder).recognize(points) for folder in (run, run / "trees"))
    neural: Any = load(run / "neural")
    product = trees.alone.clip(LEAST) * neural.alone(points, thorough=False).clip(LEAST)
    assert (both.alone > 0).all()
    ratio = both.alone / np.sqrt(product)
    np.testing.assert_allclose(ratio / ratio[:, :1], 1)
    np.testing.assert_allclose(both.alone.sum(axis=1), 1)
    np.testing.assert_allclose(both.context.sum(axis=1), 1)


def test_a_network_that_is_asked_in_haste_says_much_the_same(
    run: Path, sessions: list[LabelledSession]
) -> None:
    points = [session.points for session in sessions]
    neural: Any = load(run / "neural")
    np.testing.assert_allclose(neural.alone(points, thorough=False), neural.alone(points), atol=0.05)


def test_parts_that_know_different_labels_are_refused(run: Path) -> None:
    path = run / "neural" / "config.json"
    kept = path.read_text("utf-8")
    config = json.loads(kept)
    config["vocabulary"] = config["vocabulary"][::-1]
    path.write_text(json.dumps(config), "utf-8")
    with pytest.raises(CorruptError, match="cannot use") as error:
        load(run)
    path.write_text(kept, "utf-8")
    assert "different labels" in str(error.value)
