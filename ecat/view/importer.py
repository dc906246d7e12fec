"""``rerun-importer-ecat``: makes ``rerun my_session/`` show a session.

Rerun's own importers run beside it; ``ecat view`` shows the session alone.

Rerun calls every program named ``rerun-importer-*`` on the search path with each path that is opened, reads a
recording from its standard output, and takes exit code 66 as "not mine" (Rerun documentation, Importers).
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from ecat.errors import EcatError

INCOMPATIBLE = 66


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the session at the path of ``arguments`` to standard output; the exit code.

    Only a session's folder is taken: Rerun offers every file inside it as well, and with ``session.json`` the
    same session would come twice.
    """
    parser = argparse.ArgumentParser(
        prog="rerun-importer-ecat", description="Shows an ecat session in Rerun."
    )
    parser.add_argument("path", type=Path)
    parser.add_argument("--application-id")
    parser.add_argument("--recording-id")
    # what else Rerun recommends (times, prefixes, what is open already) does not apply to a whole session
    options, _ = parser.parse_known_args(arguments)
    if not (options.path / "session.json").is_file():
        return INCOMPATIBLE
    try:
        _write(options.path, options.application_id, options.recording_id)
    except EcatError as error:
        sys.stderr.write(f"ecat: {error}\n")
        return error.exit_code
    except BrokenPipeError:
        # the viewer was closed; what Python has left to say on its way out goes nowhere
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    return 0


def _write(path: Path, application: str | None, recording_id: str | None) -> None:
    from ecat.store import open_session
    from ecat.view.record import APPLICATION, log_session, recording
    from ecat.view.sink import written_to

    session = open_session(path)
    stream = recording(session, application=application or APPLICATION, recording_id=recording_id)
    with written_to(sys.stdout.buffer, stream):
        log_session(session, stream)


if __name__ == "__main__":
    sys.exit(main())
