"""Parts of FFV1 images are decoded alone, wherever the slices lie, and are what the whole image has there."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from ecat.store import Session
from ecat.store.media import DepthWriter, open_images
from ecat.store.media.ffv1 import Part, Slicing, choices, slices_of, suited
from tests.store.media.clips import DEPTH, PERIOD_NS, session_of

N = 6
WIDTH, HEIGHT = 203, 101


def image_of(i: int) -> NDArray[np.uint16]:
    noise = np.random.default_rng(i).normal(0, 3, (HEIGHT, WIDTH))
    return (1500 + np.arange(WIDTH) + noise).astype(np.uint16)


def encoded(image: NDArray[np.uint16], options: dict[str, str]) -> tuple[bytes, bytes]:
    """The packet and the configuration record."""
    import av

    encoder = av.VideoCodecContext.create("ffv1", "w")
    encoder.height, encoder.width = image.shape
    encoder.pix_fmt, encoder.time_base, encoder.options = "gray16le", Fraction(1, 30), options
    encoder.gop_size = 1
    frame = av.VideoFrame.from_ndarray(image, format="gray16le")
    (packet,) = [*encoder.encode(frame), *encoder.encode(None)]
    return bytes(packet), bytes(encoder.extradata or b"")


def decode(packet: bytes, record: bytes) -> NDArray[Any]:
    import av

    decoder = av.VideoCodecContext.create("ffv1", "r")
    decoder.extradata, decoder.width, decoder.height = record, WIDTH, HEIGHT
    (frame,) = decoder.decode(av.Packet(packet))
    return frame.to_ndarray()


SLICES = [
    *({"slices": n} for n in ("4", "6", "9", "12", "24", "30")),
    {"slices": "6", "coder": "range_def"},
    {"slices": "4", "qtable": "8bit"},
]


@pytest.mark.parametrize("options", SLICES)
def test_slices_cover_the_image_once_and_each_can_be_decoded_alone(options: dict[str, str]) -> None:
    packet, record = encoded(image_of(0), {"level": "3", "slicecrc": "1", **options})
    slicing = Slicing(record, WIDTH, HEIGHT)
    slices = slices_of(packet)
    assert len(slices) == int(options["slices"])
    covered = np.zeros((HEIGHT, WIDTH), int)
    for i, (start, end) in enumerate(slices):
        left, top, right, bottom = slicing.place(packet[start:end], is_first=not i)
        covered[top:bottom, left:right] += 1
        cut, there = slicing.cut(packet, [(left, top, left + 1, top + 1)])
        assert (left, top, right, bottom) in there
        assert len(there) <= 2
        found = decode(cut, record)
        np.testing.assert_array_equal(found[top:bottom, left:right], image_of(0)[top:bottom, left:right])
    assert (covered == 1).all()


def test_of_what_ecat_wrote_the_first_slice_can_be_left_out_too() -> None:
    for options in choices(WIDTH, HEIGHT):
        packet, record = encoded(image_of(0), options)
        right, bottom = WIDTH - 1, HEIGHT - 1
        cut, there = Slicing(record, WIDTH, HEIGHT).cut(packet, [(right, bottom, right + 1, bottom + 1)])
        assert len(there) == 1
        assert len(cut) < 1.3 * len(packet) / int(options["slices"])
        left, top, right, bottom = there[0]
        np.testing.assert_array_equal(
            decode(cut, record)[top:bottom, left:right], image_of(0)[top:bottom, left:right]
        )


def test_a_packet_with_a_damaged_slice_stays_whole() -> None:
    packet, record = encoded(image_of(0), choices(WIDTH, HEIGHT)[0])
    damaged = packet[:100] + bytes([packet[100] ^ 1]) + packet[101:]
    assert Slicing(record, WIDTH, HEIGHT).cut(damaged, []) == (damaged, [(0, 0, WIDTH, HEIGHT)])


@pytest.mark.parametrize("record", [b"", b"\x00" * 3, b"\xff" * 40])
def test_what_is_no_configuration_record_is_refused(record: bytes) -> None:
    with pytest.raises(ValueError, match=r"record|version"):
        Slicing(record, WIDTH, HEIGHT)


def test_images_that_lose_by_six_slices_get_four() -> None:
    assert suited(image_of(0))["slices"] == "4"  # so small that each slice is hardly learnt before it ends
    sigma = np.repeat([1.0, 5.0, 20.0], 214)[:640]  # what is learnt in a third is of no use in the next
    large = np.random.default_rng(0).normal(1500, sigma, (576, 640)).astype(np.uint16)
    assert suited(large)["slices"] == "6"
    assert {one["slices"] for one in choices(63, 63)} == {"1"}


# --- through a session


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Session:
    def write(path: Path) -> None:
        with DepthWriter(path, WIDTH, HEIGHT) as writer:
            for i in range(N):
                writer.write(image_of(i), i * PERIOD_NS)

    return session_of(tmp_path_factory.mktemp("parts") / "s", [DEPTH], {"depth": write}, n_frames=N)


PARTS = st.tuples(st.integers(0, WIDTH - 2), st.integers(0, HEIGHT - 2)).flatmap(
    lambda at: st.tuples(
        st.just(at[0]), st.just(at[1]), st.integers(at[0] + 1, WIDTH), st.integers(at[1] + 1, HEIGHT)
    )
)


@given(st.dictionaries(st.integers(0, N - 1), st.lists(PARTS, max_size=3)), st.integers(1, 2))
def test_parts_are_what_the_images_have_there(
    session: Session, wanted: dict[int, list[Part]], threads: int
) -> None:
    indices = sorted(wanted)
    parts = [wanted[i] for i in indices]
    with open_images(session, "depth", threads=threads) as images:
        found = list(images.read_parts(indices, parts))
    assert len(found) == len(indices)
    for i, image, asked in zip(indices, found, parts, strict=True):
        for left, top, right, bottom in asked:
            np.testing.assert_array_equal(image[top:bottom, left:right], image_of(i)[top:bottom, left:right])
        # what was not decoded was not measured, and is nothing of another image
        assert ((image == image_of(i)) | (image == 0)).all()


def test_less_than_the_image_is_decoded(session: Session) -> None:
    with open_images(session, "depth") as images:
        (image,) = images.read_parts([N - 1], [[(WIDTH - 2, HEIGHT - 2, WIDTH, HEIGHT)]])
    assert (image == 0).mean() > 0.7
