"""Real sessions go to every format and back, and nothing that the format carries is lost."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from ecat.formats import import_source
from ecat.formats.interchange import boris, coco, cvat, elan, epic, label_studio, plain_csv, via, vidat
from ecat.formats.interchange.times import times_of
from ecat.model import Event, Layer
from ecat.model.document import span
from ecat.store import Session, find_sessions, open_session
from tests.formats.interchange.layers import drawn_of, said_of, shapes_of, there_and_back

MODULES: tuple[Any, ...] = (elan, cvat, label_studio, coco, via, vidat, epic, boris, plain_csv)
SOURCES = ("ecat_kinect/SlideAway/Session1", "ecat_kinect/SlidePast/Session1", "ecat_movies/SampleAnnotation")


@pytest.fixture(scope="module", params=SOURCES)
def sessions(
    request: pytest.FixtureRequest, shared: Path, tmp_path_factory: pytest.TempPathFactory
) -> list[Session]:
    folder = Path(tmp_path_factory.mktemp("real")) / "made"
    import_source(shared / request.param, folder)
    return [open_session(path) for path in find_sessions(folder)]


def told(layer: Layer, session: Session, carries: frozenset[str]) -> list[Any]:
    """Every event with its images and times, and what is said of it; an image before the first is the first."""
    times = times_of(session)

    def when(event: Event) -> tuple[int, ...]:
        start, end = span(event) or (0, 0)
        made = times.of_frames(start, end)
        return (made.start_frame, made.end_frame, *times.edges_ns(made))

    return sorted((when(event), repr(said_of(event, carries))) for event in layer.events)


@pytest.mark.slow
@pytest.mark.parametrize("module", MODULES)
def test_real_annotations_come_back(module: Any, sessions: list[Session], tmp_path: Path) -> None:
    compared = 0
    for number, session in enumerate(sessions):
        options = {"width": 640, "height": 480} if module is label_studio else {}
        options |= {"tracked": False} if module is coco else {}
        folder = tmp_path / str(number)
        folder.mkdir()
        layer = session.layer()
        again, _ = there_and_back(module.FORMAT, session, folder, **options)
        carries = module.CARRIES - {"role"}
        if "event" in carries:
            assert told(again, session, carries) == told(layer, session, carries)
            compared += len(layer.events)
        if "absence" in carries:
            end = session.manifest.n_frames or 200
            assert shapes_of(again, carries, end) == drawn_of(layer, carries, end)
            compared += len(drawn_of(layer, carries, end))
    assert compared
