"""A fault of ecat itself, met in one of many sessions: reported like what is wrong with a session."""

from __future__ import annotations

from pathlib import Path

from ecat.errors import EcatError


def fault(error: Exception, again: str) -> EcatError:
    """The error to report; ``again`` is the command that shows all of it."""
    place = error.__traceback__
    while place is not None and place.tb_next is not None:
        place = place.tb_next
    line = (
        "" if place is None else f" ({Path(place.tb_frame.f_code.co_filename).name}, line {place.tb_lineno})"
    )
    return EcatError(
        f"this is a bug in ecat: {type(error).__name__}",
        where=f"{str(error).partition(chr(10))[0]}{line}",
        consequence="what was finished before is kept",
        fix=f"{again} shows all of it; report it to ecat's issue tracker",
    )
