"""A picture of the view without a display: ``python -m ecat.view.screenshot SESSION PICTURE.png``.

Needs a Vulkan driver; where there is no graphics card, a software one does (Debian: ``mesa-vulkan-drivers``).
"""

from __future__ import annotations

import argparse
import os
import signal
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ecat.errors import os_error
from ecat.view.record import log_session, recording
from ecat.view.scene import scene
from ecat.view.viewer import spawn_viewer

if TYPE_CHECKING:
    from ecat.store import Session

_SETTLE_S = 12.0
"""Until the views are drawn and the viewer's word on where it listens, which covers a corner, has gone."""
_TOP_BAR = 36
"""Rows of the viewer's menu bar, which says nothing about the session."""


def take_screenshot(
    session: Session, picture: Path, *, frame: int = 0, size: tuple[int, int] = (1440, 940)
) -> None:
    """Write what the viewer shows at ``frame`` as a PNG of ``size`` (width, height) pixels.

    Raises
    ------
    UsageError : the viewer does not start.
    StoreError : the picture cannot be written.
    """
    from rerun.experimental import ViewerClient

    # log messages would pop up before the views
    process, url = spawn_viewer("--headless", "--window-size", f"{size[0]}x{size[1]}", RUST_LOG="error")
    try:
        stream = recording(session)
        stream.connect_grpc(url)
        log_session(session, stream)
        stream.flush()
        client = ViewerClient.connect(url)
        t_ns = scene(session).timebase.t_ns
        if t_ns is None:
            client.set_time("frame", sequence=frame, play_state="paused")
        else:
            client.set_time("session_time", duration=np.timedelta64(t_ns[frame], "ns"), play_state="paused")
        time.sleep(_SETTLE_S)
        data = client.take_screenshot()
        stream.disconnect()
    finally:
        # the command is a shim around the viewer itself: both are in the group that was made for them
        os.killpg(process.pid, signal.SIGTERM)
        process.wait()
    try:
        picture.write_bytes(smaller(data, size))
    except OSError as error:
        raise os_error(error, f"cannot write {picture}", picture, "there is no picture") from error


def smaller(png: bytes, size: tuple[int, int]) -> bytes:
    """A PNG reduced to ``size`` (the viewer draws two pixels per point) and 43 shades a channel, without the menu bar.

    Noise keeps PNG from packing video and points: with all shades the picture would be twice as large.
    """
    import cv2

    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    reduced = cv2.resize(image, size, interpolation=cv2.INTER_AREA)[_TOP_BAR:]
    shades = (reduced // 6 * 6).astype(np.uint8)
    return cv2.imencode(".png", shades, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1].tobytes()


def main() -> None:
    """The command line."""
    from ecat.store import open_session

    parser = argparse.ArgumentParser(prog="python -m ecat.view.screenshot", description=__doc__)
    parser.add_argument("session", type=Path)
    parser.add_argument("picture", type=Path)
    parser.add_argument("--frame", type=int, default=0)
    options = parser.parse_args()
    take_screenshot(open_session(options.session), options.picture, frame=options.frame)


if __name__ == "__main__":
    main()
