"""The movie: images when they were taken, drawings where things are, and what is drawn with."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from ecat.errors import CorruptError, NotFoundError, UsageError
from ecat.formats.robotics.movie import FORMAT, paint
from ecat.formats.robotics.movie.lanes import Bar, Lanes, clock, rows_of
from ecat.formats.robotics.scene import stream_camera, things_of
from ecat.geometry.transforms import Rigid
from ecat.model import AnnotatedObject, Clock, Event, KeyFrame, Layer, Manifest, Segment
from ecat.sample import GroundTruth
from ecat.store import Draft, Session, create_session
from ecat.store.media import open_images
from tests.formats.robotics.scenes import HIDDEN, SIZE, bare, exported
from tests.formats.robotics.test_mcap import with_video

Image = NDArray[np.uint8]
HEIGHT = 540
"""Of the movies here: half of the usual one, so that drawing takes a quarter of the time."""


def movie(path: Path) -> tuple[list[Image], list[float]]:
    """Images, blue first, and their times."""
    with av.open(str(path)) as container:
        frames = list(container.decode(video=0))
    images = [np.asarray(frame.to_ndarray(format="bgr24"), np.uint8) for frame in frames]
    return images, [float(frame.time or 0) for frame in frames]


@pytest.fixture(scope="module")
def made(session: Session, tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Image], list[float]]:
    out = tmp_path_factory.mktemp("movie") / "it"
    exported(FORMAT, session, out, height=str(HEIGHT), every="4", qp="8")
    assert [path.name for path in out.parent.iterdir()] == ["it"]
    return movie(out)


def test_it_shows_every_image_when_it_was_taken(
    session: Session, made: tuple[list[Image], list[float]]
) -> None:
    with open_images(session, "color") as images:
        assert images.t_ns is not None
        taken = (images.t_ns[::4] - images.t_ns[0]) / 1e9
    np.testing.assert_allclose(made[1], taken, atol=1e-6)
    assert {image.shape for image in made[0]} == {(HEIGHT, HEIGHT * 16 // 9, 3)}


def view(image: Image) -> Image:
    """Where the recorded image is shown."""
    width = round(SIZE[0] * (HEIGHT - 118) / SIZE[1])
    return image[: HEIGHT - 118, :width]


def test_the_recorded_image_is_seen_where_nothing_is_drawn(
    session: Session, made: tuple[list[Image], list[float]]
) -> None:
    import cv2

    with open_images(session, "color") as images:
        (recorded,) = images.read([0])
    shown = view(made[0][0])
    true = cv2.resize(recorded, shown.shape[1::-1])
    # the upper corners are wall
    corner = np.s_[:40, :100]
    assert np.abs(shown[corner].astype(int) - true[corner]).mean() < 4


def pixel(session: Session, truth: GroundTruth, point: NDArray[np.float64]) -> NDArray[np.float64]:
    camera = stream_camera(session.manifest, session.stream("color"))
    assert camera is not None
    return (camera.project(truth.scene.depth_from_table.apply(point)) + 0.5) * (HEIGHT - 118) / SIZE[1] - 0.5


def has_color_near(
    image: Image, at: NDArray[np.float64], color: tuple[int, int, int], reach: int = 4
) -> bool:
    u, v = at.round().astype(int)
    around = image[max(v - reach, 0) : v + reach + 1, max(u - reach, 0) : u + reach + 1].astype(int)
    return bool((np.abs(around - color[::-1]).sum(-1) < 125).any())


def top_corners(truth: GroundTruth, box: int, frame: int) -> NDArray[np.float64]:
    half = np.array(truth.prototypes[box].size_m) / 2
    signs = np.array([[x, y, 1] for x in (-1, 1) for y in (-1, 1)])
    return Rigid.from_quaternion(truth.quaternion[box, frame], truth.position[box, frame]).apply(signs * half)


def test_blocks_are_outlined_where_they_are(
    filmed: tuple[Session, GroundTruth], made: tuple[list[Image], list[float]]
) -> None:
    session, truth = filmed
    things = things_of(session)
    for k in (0, 20, 40):
        for box, key in enumerate(truth.object_ids):
            corners = [pixel(session, truth, corner) for corner in top_corners(truth, box, 4 * k)]
            drawn = [has_color_near(view(made[0][k]), corner, things[key].color) for corner in corners]
            # one may lie behind a hand, a name or the other block
            assert sum(drawn) >= 3


def test_a_block_that_is_not_known_is_not_drawn(
    filmed: tuple[Session, GroundTruth], made: tuple[list[Image], list[float]]
) -> None:
    session, truth = filmed
    frame = next(f for f in HIDDEN if f % 4 == 0)
    color = things_of(session)[truth.object_ids[0]].color
    corners = [pixel(session, truth, corner) for corner in top_corners(truth, 0, frame)]
    assert not any(has_color_near(view(made[0][frame // 4]), corner, color, 2) for corner in corners)


def test_the_cursor_moves_over_the_lanes(made: tuple[list[Image], list[float]]) -> None:
    def cursor(image: Image) -> int:
        # below the lanes there is nothing else that is yellow
        blue, _, red = np.moveaxis(image[-6:-1].astype(int).mean(0), -1, 0)
        return int((red - blue).argmax())

    places = [cursor(image) for image in made[0]]
    times = np.array(made[1])
    # a straight line from the left edge to the right one
    slope, start = np.polyfit(times, places, 1)
    np.testing.assert_allclose(places, start + slope * times, atol=1.5)
    assert slope * times[-1] > 800


def test_a_part_of_the_recording_can_be_chosen(session: Session, out: Path) -> None:
    exported(FORMAT, session, out, height="240", start_s="1", end_s="1.5")
    assert 14 <= len(movie(out)[0]) <= 16


@pytest.mark.parametrize("bounds", [{"start_s": "1000"}, {"start_s": "2", "end_s": "1"}])
def test_a_part_without_images_is_a_wrong_call(session: Session, out: Path, bounds: dict[str, str]) -> None:
    with pytest.raises(UsageError):
        exported(FORMAT, session, out, **bounds)


def test_depth_can_be_shown(session: Session, out: Path) -> None:
    told = exported(FORMAT, session, out, height="240", stream="depth", end_s="0.5")
    images, _ = movie(out)
    assert len(images) == 5
    assert images[0][:100, :100].std() > 3
    assert told == ("sound left behind: audio",)


def test_a_session_without_video_is_drawn_on_black(plain: Session, out: Path) -> None:
    told = exported(FORMAT, plain, out, height="240", end_s="0.2")
    images, _ = movie(out)
    bright = (images[0][:180, :330] > 60).any(-1).mean()
    assert 0.01 < bright < 0.5
    assert told == ()


def test_shapes_drawn_by_a_person_are_shown_and_so_is_the_event(tmp_path: Path, out: Path) -> None:
    filmed = with_video(tmp_path / "s", "libx264", bf="0")
    rectangle = AnnotatedObject(
        id="o1",
        name="cup",
        kind="rectangle",
        stream="color",
        key_frames=(KeyFrame(frame=0, coordinates=(16, 12, 32, 24)),),
    )
    event = Event(id="a1", text="A cup stands", segments=(Segment(start_frame=0, end_frame=12),))
    with filmed.write() as commit:
        commit.put_layer(Layer(objects=(rectangle,), events=(event,)))
    exported(FORMAT, filmed, out, height="480", qp="5")
    images, _ = movie(out)
    assert len(images) == 24
    scale = (480 - 105) / 48
    color = things_of(filmed)["o1"].color
    for u, v in ((16, 24), (48, 24), (32, 36)):
        assert has_color_near(images[0], (np.array([u, v]) + 0.5) * scale, color)
    # the caption is there while the event lasts
    assert (images[0][330:370, 150:350] > 200).any()
    assert not (images[20][330:370, 150:350] > 200).any()


def test_shapes_are_seen_whole_where_nobody_knows_how_large_the_images_were(
    tmp_path: Path, out: Path
) -> None:
    rectangle = AnnotatedObject(
        id="o1", kind="rectangle", key_frames=(KeyFrame(frame=0, coordinates=(960, 540, 1600, 900)),)
    )
    manifest = Manifest(name="s", created="2024-01-01T00:00:00", n_frames=2)
    session = create_session(tmp_path / "s", Draft(manifest=manifest, layers=(Layer(objects=(rectangle,)),)))
    told = exported(FORMAT, session, out, height="1080", qp="5")
    image, color = movie(out)[0][0], things_of(session)["o1"].color
    # 844 rows stand for 1440 pixels
    for u, v in ((960, 900), (1760, 540), (2556, 900), (1760, 1436)):
        assert has_color_near(image, np.array([u, v]) * 844 / 1440, color)
    assert "nobody knows how large the images were; 2560 x 1440 pixels are shown" in told


def test_without_a_clock_the_images_come_thirty_times_a_second(tmp_path: Path, out: Path) -> None:
    filmed = with_video(tmp_path / "s", "libx264", bf="0")
    manifest = Manifest(
        name="s", created="2024-01-01T00:00:00", n_frames=24, streams=filmed.manifest.streams, clock=Clock()
    )
    path = filmed.stream_path("color")
    session = create_session(tmp_path / "t", Draft(manifest=manifest, files={"color": path}))
    told = exported(FORMAT, session, out, height="240")
    assert movie(out)[1][3] == pytest.approx(0.1, abs=1e-5)
    assert any("30 a second" in line for line in told)


def test_a_video_that_breaks_off_is_an_error(tmp_path: Path, out: Path) -> None:
    filmed = with_video(tmp_path / "s", "libx264", bf="0")
    video = filmed.stream_path("color")
    video.write_bytes(video.read_bytes()[: video.stat().st_size // 2])
    with pytest.raises(CorruptError):
        exported(FORMAT, filmed, out, height="240")


def test_a_session_without_anything_to_see_is_refused(tmp_path: Path, out: Path) -> None:
    with pytest.raises(NotFoundError):
        exported(FORMAT, bare(tmp_path / "s"), out)


def test_the_same_session_gives_the_same_bytes(session: Session, tmp_path: Path) -> None:
    for name in "ab":
        exported(FORMAT, session, tmp_path / name, height="240", end_s="0.5")
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


# ------------------------------------------------------------------------------------------------ drawing

bars = st.lists(
    st.builds(
        lambda tier, start, length, part: Bar(
            tier=tier, start_ns=start, end_ns=start + length, words="w", color=(1, 2, 3), is_part=part
        ),
        st.sampled_from(["event", "hand", "part"]),
        st.integers(0, 1000),
        st.integers(1, 300),
        st.booleans(),
    ),
    max_size=30,
).map(lambda found: sorted(found, key=lambda bar: bar.start_ns))


@given(bars)
def test_no_two_bars_of_a_row_overlap_and_rows_belong_to_one_tier(drawn: list[Bar]) -> None:
    names, rows = rows_of(drawn)
    for i, a in enumerate(drawn):
        assert names[rows[i]] == a.tier
        for j in range(i):
            b = drawn[j]
            assert rows[i] != rows[j] or a.start_ns >= b.end_ns or b.start_ns >= a.end_ns


@given(bars, st.integers(0, 1000), st.integers(1, 1000))
def test_lanes_can_be_drawn_whatever_overlaps(drawn: list[Bar], t_ns: int, page_ns: int) -> None:
    lanes = Lanes(drawn, (0, 1000), page_ns, shape=(60, 200), size=0.25)
    assert lanes.draw(t_ns).shape == (60, 200, 3)
    assert lanes.n_hidden == max(len(rows_of(drawn)[0]) - 8, 0)


coordinate = st.floats(-1e9, 1e9) | st.floats(-50, 50) | st.just(float("nan"))


@given(st.lists(st.tuples(coordinate, coordinate), min_size=1, max_size=6))
def test_anything_can_be_drawn_anywhere(points: list[tuple[float, float]]) -> None:
    image = np.zeros((30, 40, 3), np.uint8)
    places = np.array(points)
    paint.line(image, places, (255, 0, 0), 2, closed=True)
    paint.area(image, places, (255, 0, 0), 0.5)
    paint.dot(image, places[0], (255, 0, 0), 3)


@given(st.text(max_size=60), st.integers(8, 40), st.integers(1, 300))
def test_shortened_words_fit(words: str, size: int, width: int) -> None:
    fitting = paint.shortened(words, size, width)
    assert not fitting or paint.text_width(fitting, size) <= width


def test_a_see_through_area_mixes_with_what_is_below() -> None:
    image: Any = np.full((20, 20, 3), 100, np.uint8)
    paint.area(image, np.array([[2.0, 2], [18, 2], [18, 18], [2, 18]]), (200, 0, 100), 0.5)
    np.testing.assert_allclose(image[10, 10], [100, 50, 150], atol=1)
    assert image[0, 0].tolist() == [100, 100, 100]


def test_times_are_read_as_minutes_seconds_and_hundredths() -> None:
    assert [clock(t) for t in (0, 9_990_000_000, 61_234_000_000)] == ["0:00.00", "0:09.99", "1:01.23"]
