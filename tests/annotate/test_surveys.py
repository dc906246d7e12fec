"""A survey asks about stretches of recordings, and its answers are a table."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest

from ecat.annotate.surveys import NONE_OF_THEM, Source, answer, make_survey, results, summarize, summary_text
from ecat.cli import main
from ecat.errors import CorruptError, EcatError, ExistsError, NotFoundError, SchemaError, UsageError
from ecat.model import Event, Layer, Manifest, Segment
from ecat.model.survey import Survey
from ecat.store import Draft, create_session
from ecat.store.surveys import read_answers, read_survey, survey_names

CHOICE = Survey(name="actions", question="Which of these describes the video best?")
SCORE = Survey(name="quality", question="How good is it?", kind="score")


def event(name: str, kind: str, start: int, end: int, parent: str | None = None) -> Event:
    segments = (Segment(start_frame=start, end_frame=end),)
    return Event(id=name, type=kind, tier="event", parent=parent, segments=segments)


@pytest.fixture
def project(tmp_path: Path) -> Path:
    for clip, kind in (("clip1", "Past"), ("clip2", "Next")):
        events = (event("e1", kind, 10, 40), event("e2", "grasp", 10, 14, parent="e1"))
        manifest = Manifest(name=clip, created="2026-01-01T00:00:00Z", n_frames=60)
        create_session(tmp_path / clip, Draft(manifest=manifest, layers=(Layer(events=events),)))
    return tmp_path


def test_it_asks_about_the_events_that_are_part_of_no_other(project: Path) -> None:
    made = make_survey(project, CHOICE, Source())
    assert [(i.id, i.session, i.start_frame, i.end_frame, i.truth) for i in made.items] == [
        ("0", "clip1", 10, 40, "Past"),
        ("1", "clip2", 10, 40, "Next"),
    ]
    assert made.choices == ("Next", "Past", NONE_OF_THEM)
    assert survey_names(project) == ["actions"]
    assert read_survey(project, "actions") == made


def test_windows_lie_inside_the_recording(project: Path) -> None:
    asked = Survey(name="w", question="What happens?", choices=("push", "pull"))
    made = make_survey(project / "clip1", asked, Source(window=(0, 20, 20)))
    assert [(i.start_frame, i.end_frame) for i in made.items] == [(0, 20), (20, 40), (40, 60)]
    assert {i.session for i in made.items} == {"."}


def test_a_seed_shuffles_the_same_way_each_time(project: Path) -> None:
    orders = [
        [(i.session, i.start_frame) for i in make_survey(
            project, Survey(name=name, question="?", choices=("a",)), Source(window=(0, 5, 20)), seed=7
        ).items]
        for name in ("one", "two")
    ]  # fmt: skip
    assert orders[0] == orders[1] != sorted(orders[0])


def test_the_last_answer_of_a_person_counts(project: Path) -> None:
    make_survey(project, CHOICE, Source())
    answer(project, "actions", "0", rater="ann", said="Next")
    answer(project, "actions", "0", rater="ann", said="Past", comment="on second thought")
    answer(project, "actions", "1", rater="ben", said=NONE_OF_THEM)
    table = results(project, "actions")
    assert list(table["answer"]) == ["Past", NONE_OF_THEM]
    assert list(table["truth"]) == ["Past", "Next"]
    assert table["comment"][0] == "on second thought"
    assert len(read_answers(project, "actions")) == 3, "what was said before is kept"


def test_choices_are_compared_with_the_truth_and_each_other(project: Path) -> None:
    make_survey(project, CHOICE, Source())
    for rater, said in (("ann", ("Past", "Next")), ("ben", ("Past", "Past"))):
        for item, choice in enumerate(said):
            answer(project, "actions", str(item), rater=rater, said=choice)
    found = summarize(project, "actions")
    assert found["agreement"]["observed"] == 0.5
    assert found["agreement"]["confusion"]["accuracy"] == 0.75
    assert "4 answers by ann 2, ben 2" in summary_text(found)


def test_scores_are_averaged_by_item_and_then_by_type(project: Path) -> None:
    make_survey(project, SCORE, Source())
    for rater, scores in (("ann", (9, 2)), ("ben", (8, 3))):
        for item, score in enumerate(scores):
            answer(project, "quality", str(item), rater=rater, said=score)
    rows = {row["type"]: row["mean"] for row in summarize(project, "quality")["scores"]}
    assert rows == {"Past": 8.5, "Next": 2.5}


@pytest.mark.parametrize(
    ("name", "item", "rater", "said"),
    [
        ("actions", "9", "ann", "Past"),
        ("actions", "0", "ann", "Around"),
        ("actions", "0", " ", "Past"),
        ("actions", "0", "a" * 65, "Past"),
        ("quality", "0", "ann", 11),
        ("quality", "0", "ann", "good"),
    ],
)
def test_an_answer_that_is_none_is_refused_and_not_noted(
    project: Path, name: str, item: str, rater: str, said: str | int
) -> None:
    make_survey(project, CHOICE, Source())
    make_survey(project, SCORE, Source())
    with pytest.raises(UsageError):
        answer(project, name, item, rater=rater, said=said)
    assert read_answers(project, name) == []


def test_there_is_one_survey_of_a_name(project: Path) -> None:
    make_survey(project, CHOICE, Source())
    with pytest.raises(ExistsError):
        make_survey(project, SCORE.__class__(name="actions", question="?", kind="score"), Source())


@pytest.mark.parametrize(
    ("survey", "source"),
    [
        (CHOICE, Source(layer="nobody")),
        (CHOICE, Source(type="Around")),
        (CHOICE, Source(window=(0, 0, 20))),
        (CHOICE, Source(window=(0, 5, 20))),  # windows have no types to choose from
        (Survey(name="../up", question="?", choices=("a",)), Source()),
    ],
)
def test_a_survey_of_nothing_is_refused(project: Path, survey: Survey, source: Source) -> None:
    with pytest.raises(UsageError):
        make_survey(project, survey, source)
    assert survey_names(project) == []


@pytest.mark.parametrize("content", ["", "{}", '{"name": 3}', "[" * 100_000, "\x00"])
def test_a_file_that_is_no_survey_gives_one_typed_error(project: Path, content: str) -> None:
    (project / "surveys").mkdir()
    (project / "surveys" / "broken.json").write_text(content)
    with pytest.raises(SchemaError):
        read_survey(project, "broken")
    with pytest.raises(NotFoundError):
        read_survey(project, "other")


def test_a_torn_answer_was_never_given(project: Path) -> None:
    make_survey(project, CHOICE, Source())
    answer(project, "actions", "0", rater="ann", said="Past")
    path = project / "surveys" / "actions.answers.jsonl"
    path.write_bytes(path.read_bytes() + b'{"item": "1", "ra')
    assert len(read_answers(project, "actions")) == 1
    answer(project, "actions", "1", rater="ann", said="Next")
    assert len(read_answers(project, "actions")) == 2
    path.write_bytes(b"nonsense\n" + path.read_bytes())
    with pytest.raises(CorruptError):
        read_answers(project, "actions")


def test_the_verbs_do_all_of_it(project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def ecat(*args: object) -> str:
        assert main([str(arg) for arg in args]) == 0
        return capsys.readouterr().out

    ecat("survey", "new", project, "quality", "--question", "How good?", "--score", "0-10", "--shuffle", 1)
    ecat("survey", "answer", project, "quality", 0, 8, "--rater", "ann", "--comment", "late, but good")
    ecat("survey", "answer", project, "quality", 1, 3, "--rater", "ann")
    assert "2 answers" in ecat("survey", "list", project)
    dest = tmp_path / "out" / "answers.csv"
    found = json.loads(ecat("survey", "results", project, "quality", "-o", dest, "--json"))
    assert found["answers"] == 2
    assert pd.read_csv(dest)["comment"][0] == "late, but good"
    assert ecat("agree", dest, "--level", "interval")
    parquet = tmp_path / "out" / "answers.parquet"
    ecat("survey", "results", project, "quality", "-o", parquet)
    assert len(pd.read_parquet(parquet)) == 2


@pytest.mark.parametrize("said", [("--score", "10"), ("--window", "a,b,c"), ("--score", "0-10-20")])
def test_numbers_that_are_none_are_a_usage_error(
    project: Path, said: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["survey", "new", str(project), "x", "--question", "?", *said]) == 2
    assert "whole numbers" in capsys.readouterr().err


def test_every_error_says_what_to_do(project: Path) -> None:
    with pytest.raises(EcatError) as caught:
        summarize(project, "actions")
    assert caught.value.fix
    make_survey(project, CHOICE, Source())
    with pytest.raises(UsageError) as nobody:
        summarize(project, "actions")
    assert "nobody" in nobody.value.where
