"""``ecat learn recognize``: exports in, a model and figures out, or one error."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyarrow.parquet as pq
import pytest

from learn.recognize.dataset import SLOTS
from tests.learn.recognize import made

if TYPE_CHECKING:
    from conftest import Ecat

FEW = ("--model", "trees", "--trees", 8)


@pytest.fixture
def run(tmp_path: Path, ecat: Ecat) -> Path:
    source, dest = made.exports(tmp_path / "exports"), tmp_path / "run"
    assert ecat("learn", "recognize", "train", source, "--run", dest, *FEW, "--json").code == 0
    return dest


def test_what_was_learned_is_recognised_in_sessions_of_the_same_kind(
    run: Path, tmp_path: Path, ecat: Ecat
) -> None:
    result = ecat("learn", "recognize", "evaluate", tmp_path / "exports", "--run", run, "--json")
    assert result.code == 0, result.err
    found = result.json
    assert (found["sessions_count"], found["windows_count"], found["trained_on_count"]) == (10, 60, 10)
    assert found["windows"]["tuple"] > 0.9
    assert found["context"]["tuple"] > 0.9
    assert set(found["windows"]["slots"]) == set(SLOTS)


def test_predictions_have_a_row_for_each_window(run: Path, tmp_path: Path, ecat: Ecat) -> None:
    found = ecat("learn", "recognize", "evaluate", tmp_path / "exports", "--run", run, "--json").json
    table = pq.read_table(run / "predictions.parquet")
    rows = table.to_pylist()
    assert len(rows) == 60
    assert [rows[7][key] for key in ("file", "session", "window")] == ["pullpast", "pullpast2", 1]
    right = np.all(
        [[row[f"true_{slot}"] == row[f"context_{slot}"] for slot in SLOTS] for row in rows], axis=1
    )
    assert right.mean() == pytest.approx(found["context"]["tuple"])
    assert all(0 < row["windows_probability"] <= 1 for row in rows)


def test_the_same_seed_trains_the_same_model(run: Path, tmp_path: Path, ecat: Ecat) -> None:
    again = tmp_path / "again"
    ecat("learn", "recognize", "train", tmp_path / "exports", "--run", again, *FEW)
    with np.load(run / "model.npz") as one, np.load(again / "model.npz") as two:
        assert set(one) == set(two)
        assert all((one[name] == two[name]).all() for name in one)


def test_a_model_of_other_features_is_refused_by_name(run: Path, tmp_path: Path, ecat: Ecat) -> None:
    config = json.loads((run / "config.json").read_text("utf-8"))
    (run / "config.json").write_text(json.dumps(config | {"features": "windows-0"}), "utf-8")
    result = ecat("learn", "recognize", "evaluate", tmp_path / "exports", "--run", run)
    assert result.code == 1
    assert "windows-0" in result.err


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04 not a model", b"\x80\x04K\x01."])
def test_a_damaged_model_is_one_error(damage: bytes, run: Path, tmp_path: Path, ecat: Ecat) -> None:
    (run / "model.npz").write_bytes(damage)
    result = ecat("learn", "recognize", "evaluate", tmp_path / "exports", "--run", run, "--json")
    assert (result.code, result.json["error"]["error"]) == (1, "CorruptError")


def test_a_run_is_not_overwritten_and_one_that_is_not_there_is_missed(
    run: Path, tmp_path: Path, ecat: Ecat
) -> None:
    twice = ecat("learn", "recognize", "train", tmp_path / "exports", "--run", run, "--json")
    assert (twice.code, twice.json["error"]["error"]) == (1, "ExistsError")
    none = ecat("learn", "recognize", "evaluate", tmp_path / "exports", "--run", tmp_path / "no", "--json")
    assert (none.code, none.json["error"]["error"]) == (1, "NotFoundError")


def test_cross_validation_gives_a_table_pictures_and_predictions(tmp_path: Path, ecat: Ecat) -> None:
    source, run = made.exports(tmp_path / "exports", 10), tmp_path / "folds"
    result = ecat(
        "learn",
        "recognize",
        "crossval",
        source,
        "--run",
        run,
        "--seeds",
        2,
        "--model",
        "trees",
        "--trees",
        2,
        "--json",
    )
    assert result.code == 0, result.err
    assert set(result.json["baselines"]) == {"majority", "marginals", "logistic"}
    assert set(result.json["runs"]) == {"0", "1"}
    for picture in ("confusion_context.png", "limits.png"):
        assert (run / picture).read_bytes().startswith(b"\x89PNG")
    said = json.loads((run / "limits.json").read_text("utf-8"))["context"]
    assert sum(row["windows"] for row in said["by_distance"]) == said["by_slot"]["windows"] == 120
    assert pq.read_table(run / "predictions.parquet")["session"].to_pylist()[::6][:3] == [
        "pullpast1",
        "pullpast2",
        "pullpast3",
    ]


@pytest.mark.slow
def test_real_sessions_are_recognised(shared: Path, tmp_path: Path, ecat: Ecat) -> None:
    """Trained on half of three files, a few trees tell most windows of the other half."""
    from learn.recognize.dataset import read_exports
    from learn.recognize.evaluation import predicted, scores
    from learn.recognize.model import Settings, train

    for name in ("pushto", "rollpast", "selfslidefrom"):
        (tmp_path / f"{name}.txt").symlink_to((shared / "actions_ch4" / "xml" / f"{name}.txt").resolve())
    sessions = read_exports(tmp_path)
    recognizer = train(sessions[::2], Settings(n_trees=15))
    found = predicted(sessions[1::2], recognizer.recognize([session.points for session in sessions[1::2]]))
    figures = scores(found)
    assert figures["windows"]["tuple"] > 0.8
    assert figures["context"]["tuple"] > figures["windows"]["tuple"] - 0.02


@pytest.mark.parametrize("model", ["hmm", "mlp", "qual-lstm-crf", "neural", "mixture"])
def test_every_model_is_trained_and_evaluated_by_the_same_commands(
    model: str, tmp_path: Path, ecat: Ecat
) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed: pip install 'ecat[learn]'")
    source, run = made.exports(tmp_path / "exports"), tmp_path / "run"
    size = () if model == "hmm" else ("--epochs", 2, "--hidden", 8, "--validation", 0.4)
    # the mixture is what is trained if nothing is said
    said = ("--trees", 8) if model == "mixture" else ("--model", model)
    trained = ecat("learn", "recognize", "train", source, "--run", run, *said, *size, "--json")
    assert trained.code == 0, trained.err
    assert json.loads((run / "config.json").read_text("utf-8"))["model"] == model
    pictures = {path.name for path in run.glob("*.png")}
    assert pictures == (
        set() if model == "hmm" else {"curves.png", "confusion_windows.png", "confusion_context.png"}
    )
    assert not (run / "checkpoint.npz").exists()
    found = ecat("learn", "recognize", "evaluate", source, "--run", run, "--json").json
    assert (found["windows_count"], found["trained_on_count"]) == (60, 10)
    assert pq.read_table(run / "predictions.parquet").num_rows == 60
    assert (run / "confusion_context.png").is_file()


def test_cross_validation_of_another_model_is_kept_fold_by_fold(tmp_path: Path, ecat: Ecat) -> None:
    source, run = made.exports(tmp_path / "exports", 10), tmp_path / "folds"
    result = ecat(
        "learn", "recognize", "crossval", source, "--run", run, "--model", "lds", "--share", 0.5, "--json"
    )
    assert result.code == 0, result.err
    assert (result.json["model"], result.json["share"]) == ("lds", 0.5)
    assert len(list((run / "folds").glob("*.npz"))) == 5
    assert (run / "confusion_windows.png").is_file()


def test_the_figures_of_a_cross_validation_are_not_replaced_by_those_of_another(
    tmp_path: Path, ecat: Ecat
) -> None:
    source, run = made.exports(tmp_path / "exports", 10), tmp_path / "folds"
    command = ("learn", "recognize", "crossval", source, "--run", run, "--json")
    trees = ("--model", "trees", "--trees", 1)
    assert ecat(*command, *trees).code == 0
    before = (run / "crossval.json").read_bytes()
    for other in (
        ("--model", "lds"),
        (*trees, "--folds", "blocks"),
        (*trees, "--share", 0.5),
        ("--model", "trees", "--trees", 2),
    ):
        # nothing is read before that is said
        refused = ecat("learn", "recognize", "crossval", tmp_path / "none", "--run", run, "--json", *other)
        error = refused.json["error"]
        assert (refused.code, error["error"]) == (1, "ExistsError")
        assert "--model trees --folds random --share 1.0 --trees 1" in error["where"]
    assert (run / "crossval.json").read_bytes() == before
    again = ecat(*command, *trees, "--seeds", 2)
    assert (again.code, set(again.json["runs"])) == (0, {"0", "1"})
    more = made.exports(tmp_path / "more", 11)
    others = ecat("learn", "recognize", "crossval", more, "--run", run, "--json", *trees)
    assert (others.code, others.json["error"]["error"]) == (1, "ExistsError")
    assert "other sessions" in others.json["error"]["where"]
    (run / "crossval.json").write_text("{broken", "utf-8")
    damaged = ecat(*command, *trees)
    assert (damaged.code, damaged.json["error"]["error"]) == (1, "CorruptError")


@pytest.mark.parametrize(
    ("model", "option"),
    [("trees", "--epochs"), ("hmm", "--hidden"), ("mlp", "--layers"), ("neural", "--trees")],
)
def test_an_option_that_a_model_has_no_use_for_is_refused(
    model: str, option: str, tmp_path: Path, ecat: Ecat
) -> None:
    source, run = made.exports(tmp_path / "exports", 1), tmp_path / "run"
    result = ecat("learn", "recognize", "train", source, "--run", run, "--model", model, option, 3, "--json")
    assert (result.code, result.json["error"]["error"]) == (2, "UsageError")
    assert option in result.json["error"]["where"]
    assert not run.exists()


@pytest.mark.parametrize("option", ["--rate", "--validation"])
def test_no_number_is_no_share_and_no_rate(option: str, tmp_path: Path, ecat: Ecat) -> None:
    result = ecat("learn", "recognize", "train", tmp_path, "--run", tmp_path / "run", option, "nan", "--json")
    assert (result.code, result.json["error"]["error"]) == (2, "UsageError")
    assert option in result.json["error"]["what"]


def unfinished(run: Path) -> None:
    """As if training had been interrupted when its model was being written."""
    (run / "config.json").unlink()
    for part in (run, run / "trees", run / "neural"):
        (part / "metrics.json").unlink(missing_ok=True)


@pytest.mark.parametrize("said", [FEW, ("--trees", 2, "--epochs", 1, "--hidden", 8)])
def test_a_run_that_was_interrupted_while_it_was_written_is_finished(
    said: tuple[object, ...], tmp_path: Path, ecat: Ecat
) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed: pip install 'ecat[learn]'")
    command = (
        "learn",
        "recognize",
        "train",
        made.exports(tmp_path / "exports", 2),
        "--run",
        tmp_path / "run",
    )
    assert ecat(*command, *said).code == 0
    unfinished(tmp_path / "run")
    assert ecat(*command, *said).code == 0
    found = ecat("learn", "recognize", "evaluate", tmp_path / "exports", "--run", tmp_path / "run")
    assert found.code == 0, found.err


def test_a_run_of_its_own_is_not_taken_for_a_part(tmp_path: Path, ecat: Ecat) -> None:
    source, run = made.exports(tmp_path / "exports", 2), tmp_path / "run"
    assert ecat("learn", "recognize", "train", source, "--run", run / "trees", *FEW).code == 0
    result = ecat("learn", "recognize", "train", source, "--run", run, "--json")
    assert (result.code, result.json["error"]["error"]) == (1, "ExistsError")
    assert "trees" in result.json["error"]["where"]


@pytest.mark.parametrize("verb", ["train", "crossval"])
@pytest.mark.parametrize("place", ["file", "file/run", "run"])
def test_a_place_that_is_taken_is_told_before_anything_is_read(
    verb: str, place: str, tmp_path: Path, ecat: Ecat
) -> None:
    (tmp_path / "file").write_text("mine", "utf-8")
    (tmp_path / "run").mkdir()
    for name in ("metrics.json", "crossval.json"):
        (tmp_path / "run" / name).write_text("mine", "utf-8")
    result = ecat("learn", "recognize", verb, tmp_path / "no exports", "--run", tmp_path / place, "--json")
    assert result.code == 1
    assert "no exports" not in json.dumps(result.json["error"])
    assert {path.name for path in tmp_path.iterdir()} == {"file", "run"}


@pytest.mark.parametrize(
    ("there", "verb"),
    [
        *(
            (name, "crossval")
            for name in ("config.json", "metrics.json", "checkpoint.npz", "trees/config.json")
        ),
        *((name, "train") for name in ("crossval.json", "folds/trees-random-0-0.npz")),
    ],
)
def test_a_training_and_a_cross_validation_do_not_write_into_each_others_folders(
    there: str, verb: str, tmp_path: Path, ecat: Ecat
) -> None:
    run = tmp_path / "run"
    (run / there).parent.mkdir(parents=True)
    (run / there).write_text("{}", "utf-8")
    result = ecat("learn", "recognize", verb, tmp_path / "no exports", "--run", run, *FEW, "--json")
    assert (result.code, result.json["error"]["error"]) == (1, "ExistsError")
    assert there.split("/", maxsplit=1)[0] in result.json["error"]["where"]
    assert "another folder" in result.json["error"]["fix"]
    assert [path for path in run.rglob("*") if path.is_file()] == [run / there]


def test_the_folder_of_a_cross_validation_has_no_model_and_that_is_said(tmp_path: Path, ecat: Ecat) -> None:
    (tmp_path / "crossval.json").write_text("{}", "utf-8")
    result = ecat("learn", "recognize", "evaluate", tmp_path, "--run", tmp_path, "--json")
    assert (result.code, result.json["error"]["error"]) == (1, "NotFoundError")
    assert "cross-validation" in result.json["error"]["where"]


def test_that_nothing_says_when_to_stop_is_told_and_how_it_would(tmp_path: Path, ecat: Ecat) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed: pip install 'ecat[learn]'")
    source = made.exports(tmp_path / "exports", 2)
    small = ("--model", "mlp", "--epochs", 1, "--hidden", 4)
    result = ecat("learn", "recognize", "train", source, "--run", tmp_path / "run", *small)
    assert result.code == 0, result.err
    assert "nothing says when to stop: of 4 sessions, 2 a file or fewer, a share of 0.1 is none" in result.out
    share = result.out.partition("--validation ")[2].split()[0]
    command = ("learn", "recognize", "train", source, "--run", tmp_path / "other", *small)
    again = ecat(*command, "--validation", share, "--json")
    assert (again.code, again.json["findings"]) == (0, [])
    assert len(again.json["validation"]) == 2
    five = made.write(source / "more.txt", made.session("more1", made.scene(1), made.labels(1))).parent
    enough = ecat("learn", "recognize", "train", five, "--run", tmp_path / "five", *small, "--json")
    assert (enough.code, enough.json["findings"]) == (0, [])
    assert len(enough.json["validation"]) == 1


def test_without_pictures_nothing_that_was_computed_is_lost(
    tmp_path: Path, ecat: Ecat, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed: pip install 'ecat[learn]'")
    for name in ("matplotlib", "matplotlib.figure"):
        monkeypatch.setitem(sys.modules, name, None)
    source, run, folds = made.exports(tmp_path / "exports", 10), tmp_path / "run", tmp_path / "folds"
    small = ("--model", "mlp", "--epochs", 1, "--hidden", 4, "--validation", 0.4)
    trained = ecat("learn", "recognize", "train", source, "--run", run, *small, "--json")
    evaluated = ecat("learn", "recognize", "evaluate", source, "--run", run, "--json")
    validated = ecat(
        "learn", "recognize", "crossval", source, "--run", folds, "--model", "trees", "--trees", 1, "--json"
    )
    for result in (trained, evaluated, validated):
        assert result.code == 0, result.err
        assert "Matplotlib is not installed" in result.json["findings"][0]
    files = {path.name for path in run.iterdir()}
    assert files >= {"metrics.json", "evaluation.json", "predictions.parquet"}
    assert {path.name for path in folds.iterdir()} >= {"crossval.json", "limits.json", "predictions.parquet"}
    assert "checkpoint.npz" not in files
    assert "validation_scores" in json.loads((run / "metrics.json").read_text("utf-8"))
    assert len(list((folds / "folds").glob("trees-*.npz"))) == 5


@pytest.mark.parametrize("model", ["trees", "mixture"])
def test_where_nothing_happens_nothing_is_learned(model: str, tmp_path: Path, ecat: Ecat) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed: pip install 'ecat[learn]'")
    nothing = ["None,None,None,None,None"] * 6
    sessions = [made.session(f"a{number}", made.scene(number), nothing) for number in (1, 2)]
    source = made.write(tmp_path / "exports/a.txt", *sessions).parent
    result = ecat(
        "learn", "recognize", "train", source, "--run", tmp_path / "run", "--model", model, "--json"
    )
    assert (result.code, result.json["error"]["error"]) == (1, "InputError")
    assert "moves" in result.json["error"]["where"]
    assert not (tmp_path / "run").exists()
