"""The Rerun viewer as a process of its own: it listens on this machine only and reports nothing to anyone."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from ecat.errors import UsageError
from ecat.progress import Progress, silent
from ecat.view.record import log_session, recording

if TYPE_CHECKING:
    from ecat.store import Session

_LOOPBACK = "127.0.0.1"
_PATIENCE_S = 30.0
# the viewer reads whether it may report usage from the user's settings folder; this one says no
SETTINGS = Path(__file__).parent / "settings"


def open_viewer(session: Session, *, progress: Progress = silent) -> tuple[str, ...]:
    """Open a viewer window and send it the session; the window outlives this process.

    Returns
    -------
    A line for each stream of which not all images can be shown.

    Raises
    ------
    UsageError : there is no display, or the window closed before it had everything.
    """
    # the viewer would first listen, and only then find out that it cannot open a window
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise _no_viewer("there is no display here")
    _, url = spawn_viewer()
    stream = recording(session)
    stream.connect_grpc(url)
    try:
        damage = log_session(session, stream, progress=progress)
        stream.flush()
    except RuntimeError as error:
        raise _no_viewer(f"the window went away: {error}") from error
    finally:
        stream.disconnect()
    return damage


def spawn_viewer(*options: str, **environment: str) -> tuple[subprocess.Popen[bytes], str]:
    """Start a viewer with further command-line ``options``, and return it and its address once it listens.

    Raises
    ------
    UsageError : it ended, or did not listen within half a minute.
    """
    with socket.socket() as probe:
        probe.bind((_LOOPBACK, 0))
        port: int = probe.getsockname()[1]
    command = [
        sys.executable,
        "-m",
        "rerun_cli",
        "--bind",
        _LOOPBACK,
        "--port",
        str(port),
        "--expect-data-soon",
    ]
    process = subprocess.Popen(
        [*command, *options],
        env={**os.environ, "XDG_CONFIG_HOME": str(SETTINGS), "RERUN_APP_ONLY": "true", **environment},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    deadline = time.monotonic() + _PATIENCE_S
    while time.monotonic() < deadline and process.poll() is None:
        with socket.socket() as probe:
            if probe.connect_ex((_LOOPBACK, port)) == 0:
                return process, f"rerun+http://{_LOOPBACK}:{port}/proxy"
        time.sleep(0.1)
    process.kill()
    ended = process.returncode
    raise _no_viewer("it did not start in time" if ended is None else f"it ended with code {ended}")


def _no_viewer(why: str) -> UsageError:
    return UsageError(
        "cannot open the Rerun viewer",
        where=why,
        consequence="nothing was shown",
        fix="ecat view SESSION --save FILE.rrd, then open the file where there is a display",
    )
