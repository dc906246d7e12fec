"""Stages run side by side where none needs what the other makes, and leave what they would have left in turn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from threading import Barrier, BrokenBarrierError

import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.errors import CorruptError
from ecat.model.prototype import NOMINAL_BOXES
from ecat.process import process_session
from ecat.process.running import side_by_side
from ecat.sample import sample_session
from ecat.stages import STAGES, Stage
from ecat.store import Session, create_session
from ecat.tables import TABLES

PATIENCE_S = 30.0
STAGE = {stage.name: stage for stage in STAGES}


@pytest.fixture
def session(tmp_path: Path) -> Session:
    return create_session(tmp_path / "s", sample_session(seed=1, actions=("next",))[0])


def of_images(name: str, table: str, inputs: tuple[str, ...] = ()) -> Stage:
    """A stage that makes an empty table, and would look at depth if there were any."""

    def run(*_: object) -> dict[str, pa.Table]:
        return {table: TABLES[table].arrow.empty_table()}

    plane = STAGE["plane"]
    return replace(plane, name=name, inputs=inputs, optional=("depth",), outputs=(table,), run=run)


def failing(stage: Stage) -> Stage:
    def run(*_: object) -> dict[str, pa.Table]:
        raise CorruptError(f"cannot run {stage.name}", where="it fails", consequence="none", fix="none")

    return replace(stage, run=run)


def run_stages(session: Session, monkeypatch: pytest.MonkeyPatch, *stages: Stage) -> list[tuple[str, int]]:
    """Run these stages on the session; what it said of its progress."""
    said: list[tuple[str, int]] = []
    monkeypatch.setattr("ecat.stages.STAGES", stages)

    def progress(what: str, done: int, total: int) -> None:
        assert total == len(stages)
        said.append((what, done))

    process_session(session.path, prototypes=NOMINAL_BOXES, progress=progress)
    return said


def stage_of(session: Session) -> Mapping[str, str]:
    mine = {FACES.name, OUTLINE.name}
    return {r.name: r.stage for r in session.refresh().manifest.tables if r.stage in mine}


FACES, OUTLINE = of_images("faces", "face_planes"), of_images("edge", "table_outline")


def test_planes_of_faces_and_of_the_table_are_measured_side_by_side() -> None:
    names = [tuple(stage.name for stage in together) for together in side_by_side(STAGES)]
    others = [(name,) for name in ("outline", "pose", "smooth", "hull", "relations", "propose")]
    assert names == [("track",), ("face_planes", "plane"), *others]


@given(st.lists(st.sampled_from(STAGES), unique_by=lambda stage: stage.name))
def test_the_order_stays_and_none_waits_for_what_is_made_beside_it(stages: list[Stage]) -> None:
    groups = list(side_by_side(stages))
    assert [stage for group in groups for stage in group] == stages
    for group in groups:
        assert len(group) == 1 or all(stage.images for stage in group)
        for k, stage in enumerate(group):
            assert not {name for other in group[:k] for name in other.outputs} & set(stage.inputs)


def test_stages_that_stand_side_by_side_run_at_the_same_time(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    met = Barrier(2)

    def meeting(stage: Stage) -> Stage:
        def run(*arguments: object) -> dict[str, pa.Table]:
            try:
                met.wait(PATIENCE_S)
            except BrokenBarrierError:
                pytest.fail("one waits for the other")
            return stage.run(*arguments)  # type: ignore[arg-type]

        return replace(stage, run=run)

    said = run_stages(session, monkeypatch, meeting(FACES), meeting(OUTLINE))
    assert said == [("faces, edge", 0), ("faces", 1), ("edge", 2)]
    assert stage_of(session) == {"face_planes": "faces", "table_outline": "edge"}


def test_what_fails_keeps_nothing_from_being_written_that_comes_before_it(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(CorruptError, match="cannot run edge"):
        run_stages(session, monkeypatch, FACES, failing(OUTLINE))
    assert stage_of(session) == {"face_planes": "faces"}
    assert run_stages(session, monkeypatch, FACES, OUTLINE) == [("faces", 1), ("edge", 1), ("edge", 2)]


def test_the_first_in_order_that_fails_is_what_one_hears_of_and_nothing_after_it_is_written(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    for second in (OUTLINE, failing(OUTLINE)):
        with pytest.raises(CorruptError, match="cannot run faces"):
            run_stages(session, monkeypatch, failing(FACES), second)
        assert stage_of(session) == {}
