"""Ten thousand events take seconds, and their time grows as their number does."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest

from ecat.formats.interchange import boris, cvat, elan, epic, label_studio, plain_csv, via, vidat
from ecat.formats.interchange.times import times_of_clock
from ecat.model import AnnotatedObject, Clock, Event, Layer, Manifest, Role, Stream
from ecat.progress import silent
from ecat.store import Draft, create_session
from tests.formats.interchange.layers import Holding

N = 10_000
N_FRAMES = 200_000
MODULES: tuple[Any, ...] = (elan, cvat, label_studio, via, vidat, epic, boris, plain_csv)


def many(n: int) -> Layer:
    """Actions of four parts each, one after the other."""
    times = times_of_clock(Clock(rule="uniform", duration_ns=(N_FRAMES - 1) * 33_333_333), N_FRAMES)
    events: list[Event] = []
    for number in range(n):
        action = number // 5 * 5
        start = action * 12 + 3
        at = number - action
        pair = (start, start + 48) if at == 0 else (start + 12 * (at - 1), start + 12 * at)
        events.append(
            Event(
                id=f"a{number + 1}",
                type="slide" if at == 0 else f"part {at}",
                tier="action" if at == 0 else "part",
                parent=None if at == 0 else f"a{action + 1}",
                text=f"Slide number {number}",
                segments=(times.of_frames(*pair),),
                roles=(
                    Role(name="Theme", target="o1"),
                    Role(name="Agent", target="o2/HandRight", kind="joint"),
                ),
            )
        )
    things = (AnnotatedObject(id="o1", name="Shell"), AnnotatedObject(id="o2", name="Performer"))
    return Layer(events=tuple(events), objects=things)


@pytest.mark.slow
@pytest.mark.parametrize("module", MODULES)
def test_ten_thousand_events_go_out_and_come_back_in_seconds(module: Any, tmp_path: Path) -> None:
    manifest = Manifest(
        name="s", created="2026-01-01", n_frames=N_FRAMES,
        clock=Clock(rule="uniform", duration_ns=(N_FRAMES - 1) * 33_333_333),
        streams=(Stream(name="color", kind="color", width_px=640, height_px=480),),
    )  # fmt: skip
    base = create_session(tmp_path / "s", Draft(manifest=manifest, layers=(Layer(),)))
    seconds: list[float] = []
    for n in (N // 4, N):
        session = Holding(base, many(n))
        dest = tmp_path / f"{n}{module.FORMAT.suffix}"
        begun = time.process_time()
        module.part(session, "s", dest, module.FORMAT.options(), silent)
        layer, _ = module.FORMAT.read_layer(dest, session)
        seconds.append(time.process_time() - begun)
        assert len(layer.events) == n
    assert seconds[1] < 20
    assert seconds[1] < 12 * seconds[0] + 1
