"""What the streams of a session are called in a data set, where names have fewer characters, and others are taken."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from ecat.errors import InputError

Names = Callable[[str], Sequence[str]]
"""What a data set calls the stream of this name, and what belongs to the stream."""


def plain_name(stream: str) -> str:
    """Without slashes, which would be folders."""
    return stream.replace("/", "_")


def require_unlike(
    streams: Iterable[str], names: Names, *, taken: Sequence[str] = (), option: str = "streams"
) -> None:
    """Return if no two of ``streams``, which may be of several sessions, have a name in common.

    ``taken`` are names of what else there is; ``option`` is the one that says which streams are wanted.

    Raises
    ------
    InputError : two have, or one is called as what else there is.
    """
    owners = dict.fromkeys(taken, "")
    for stream in dict.fromkeys(streams):
        for name in names(stream):
            if name in owners:
                other = f"stream {owners[name]}" if owners[name] else "what the data set itself calls so"
                raise InputError(
                    f"cannot tell stream {stream} from {other}",
                    where=f"both would be called {name} in the data set",
                    consequence="neither was written",
                    fix=f"--option {option}=NAME,... with one of the two; or export their sessions apart",
                )
        owners |= dict.fromkeys(names(stream), stream)
