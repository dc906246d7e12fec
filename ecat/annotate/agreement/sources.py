"""Which layers are compared with which: those of one session, or the same session of several projects."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import TypeAlias

from ecat.annotate.agreement.compare import Agreement
from ecat.annotate.agreement.objects import match_objects
from ecat.errors import EcatError, NotFoundError, UsageError
from ecat.model import Layer
from ecat.model.annotation import MACHINE
from ecat.progress import Progress, silent
from ecat.store import Session, find_sessions, open_session

Elsewhere: TypeAlias = dict[tuple[int, int], dict[str, str]]
"""By the places of two raters: objects of the one, as ``<session>/<object id>``, and what the other calls them."""


@dataclass(frozen=True, slots=True)
class Compared:
    """The agreement found, and the sessions that could not be compared, each with the reason."""

    agreement: Agreement
    left_out: list[tuple[str, str]]


def agree(paths: Sequence[Path], layers: Sequence[str] = (), *, progress: Progress = silent) -> Compared:
    """Compare annotators.

    Parameters
    ----------
    paths : one session or project: its layers are compared with each other, in every session that has them.  Two or
        more: the sessions of the same name are, each annotator in a copy of their own.
    layers : of one path, which ones (by default all that people made); of several, the one layer meant, or one each.

    Raises
    ------
    UsageError : there is nothing to compare, or the layers named do not fit.
    NotFoundError : nothing of ecat's is at a path, or no session could be compared.
    """
    if len(paths) == 1:
        return _within(find_sessions(paths[0]), layers, progress)
    return _across(paths, layers, progress)


def _within(sessions: Sequence[Path], layers: Sequence[str], progress: Progress) -> Compared:
    left_out: list[tuple[str, str]] = []
    opened = [session for path in sessions if (session := _opened(path, left_out)) is not None]
    names = tuple(layers) or _people(opened)
    if len(names) < 2:
        raise UsageError(
            "cannot compare one annotator",
            where=f"the layers that people made are: {', '.join(names) or 'none'}",
            fix="name two layers with --layer, or give two projects: ecat agree FIRST SECOND",
        )
    found = Agreement(names)
    for done, session in enumerate(opened):
        progress("comparing", done, len(opened))
        if missing := [name for name in names if session.manifest.layer(name) is None]:
            left_out.append((session.path.name, f"has no layer {missing[0]}"))
            continue
        _add(found, [(session, name) for name in names], left_out)
    return _checked(found, left_out)


def _opened(path: Path, left_out: list[tuple[str, str]]) -> Session | None:
    """The session, or a remark on why it is left out."""
    try:
        return open_session(path)
    except EcatError as error:
        left_out.append((path.name, error.what))
        return None


def _people(sessions: Iterable[Session]) -> tuple[str, ...]:
    names = {record.name for session in sessions for record in session.manifest.layers}
    return tuple(sorted(names - {MACHINE, "gold"}))


def _across(paths: Sequence[Path], layers: Sequence[str], progress: Progress) -> Compared:
    names = tuple(layers) or ("main",)
    if len(names) not in {1, len(paths)}:
        fix = f"name one layer, or {len(paths)}"
        raise UsageError("cannot compare", where=f"{len(names)} layers for {len(paths)} paths", fix=fix)
    names = names * len(paths) if len(names) == 1 else names
    alone = [len(sessions) == 1 for sessions in map(find_sessions, paths)]
    folders = [_by_name(path, single=all(alone)) for path in paths]
    common = sorted(set.intersection(*(set(by_name) for by_name in folders)))
    found = Agreement(_raters(paths, names))
    left_out = [
        (name, "not in all of them")
        for name in sorted(set.union(*(set(by_name) for by_name in folders)) - set(common))
    ]
    elsewhere: Elsewhere = {pair: {} for pair in combinations(range(len(paths)), 2)}
    for done, name in enumerate(common):
        progress("pairing objects", done, len(common))
        _pair(
            elsewhere,
            name,
            [_layer(by_name[name], layer) for by_name, layer in zip(folders, names, strict=True)],
        )
    for done, name in enumerate(common):
        progress("comparing", done, len(common))
        sessions = [open_session(by_name[name]) for by_name in folders]
        _add(found, list(zip(sessions, names, strict=True)), left_out, elsewhere)
    return _checked(found, left_out)


def _layer(session: Path, name: str) -> Layer | None:
    """The layer, or None if it cannot be read: why is said where it is compared."""
    try:
        return open_session(session).layer(name)
    except EcatError:
        return None


def _pair(elsewhere: Elsewhere, session: str, layers: Sequence[Layer | None]) -> None:
    """Add which objects of a session are the same, as relations of other sessions name them."""
    for i, j in elsewhere:
        first, second = layers[i], layers[j]
        if first is not None and second is not None:
            for a, (b, _) in match_objects(first.objects, second.objects).items():
                elsewhere[i, j][f"{session}/{a}"] = f"{session}/{b}"


def _by_name(path: Path, *, single: bool) -> dict[str, Path]:
    """Sessions by name, the first of several; two single sessions are compared whatever they are called."""
    found: dict[str, Path] = {}
    for folder in find_sessions(path):
        found.setdefault("" if single else folder.name, folder)
    return found


def _raters(paths: Sequence[Path], layers: Sequence[str]) -> tuple[str, ...]:
    names = [path.resolve().name for path in paths]
    if len(set(names)) < len(names):
        names = [str(path) for path in paths]
    return tuple(
        f"{name}:{layer}" if layer != "main" else name for name, layer in zip(names, layers, strict=True)
    )


def _add(
    found: Agreement,
    parts: Sequence[tuple[Session, str]],
    left_out: list[tuple[str, str]],
    elsewhere: Elsewhere | None = None,
) -> None:
    try:
        layers = [session.layer(name) for session, name in parts]
    except EcatError as error:
        left_out.append((parts[0][0].path.name, f"{error.what}: {error.where}"))
        return
    if not any(map(_says_something, layers)):
        left_out.append((parts[0][0].path.name, "nobody annotated anything"))
        return
    n_frames = max(session.manifest.n_frames for session, _ in parts)
    found.add(layers, n_frames, elsewhere=elsewhere or {})


def _says_something(layer: Layer) -> bool:
    return bool(layer.objects or layer.events or layer.relations)


def _checked(found: Agreement, left_out: list[tuple[str, str]]) -> Compared:
    if not found.sessions:
        reasons = tuple(f"{name}: {why}" for name, why in left_out[:5])
        fix = "check the paths and the names of the layers (ecat info PATH)"
        raise NotFoundError("cannot compare: no session is annotated by all", where=reasons, fix=fix)
    return Compared(found, left_out)


def reasons(left_out: Iterable[tuple[str, str]]) -> Iterator[tuple[str, int]]:
    """How many sessions were left out for each reason."""
    counts: dict[str, int] = {}
    for _, why in left_out:
        counts[why] = counts.get(why, 0) + 1
    yield from sorted(counts.items(), key=lambda item: -item[1])
