"""Joins the data sets of single sessions to one: rows are numbered anew, packets of video are passed on as they are."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from ecat.errors import CorruptError, FormatError
from ecat.formats.episodes import clock_method
from ecat.formats.format import Part
from ecat.formats.lerobot import card, layout
from ecat.formats.lerobot.dataset import PRIVATE, DatasetWriter, Facts, Record, Sampled, write_json
from ecat.formats.lerobot.language import Entry
from ecat.formats.lerobot.layout import ACTION, STATE, Layout, View, file_name
from ecat.formats.lerobot.options import LeRobotOptions
from ecat.formats.lerobot.part import MADE
from ecat.formats.lerobot.video import TICKS, Clip, PacketFile
from ecat.progress import Progress
from ecat.store import write_new_file


@dataclass(frozen=True)
class _Made:
    """What a part says of itself."""

    part: Part
    state: tuple[str, ...]
    action: tuple[str, ...]
    views: dict[str, View]
    n_episodes: int
    who: str
    choices: dict[str, Any]


def merge(parts: Sequence[Part], dest: Path, options: LeRobotOptions, progress: Progress) -> tuple[str, ...]:
    """Join parts to the data set ``dest``; see :class:`ecat.formats.format.Merger`.

    All episodes of a data set have the same columns and cameras.  Columns: those of any part; where a part has not one,
    it is zero there, and ``state_known`` says so.  Cameras: those that most parts have, in the size that most have them
    in; others are left out, and so are parts without all of these.

    Raises
    ------
    CorruptError : a part is damaged.
    InputError : streams of different sessions would be the same camera.
    """
    known = [_about(part) for part in parts]
    kept, views, findings = _agreed(known)
    # a stream has an offset in whatever part shows it
    streams = (name for made in kept for name in made.choices["worst_offset_s"])
    layout.require_unlike_videos(name for name in streams if layout.video_key(name) in views)
    shape = Layout(
        fps=options.fps,
        state=_union(made.state for made in kept),
        action=_union(made.action for made in kept),
        views=views,
        language=options.language,
    )
    kept, test = _split(kept, options)
    if options.split != "none" and not test:
        findings.append(
            f"there is no split test: all sessions are of one {options.split}, or nobody says of which"
        )
    with DatasetWriter(dest, shape, private=False) as writer:
        for number, made in enumerate(kept):
            progress(made.part.label, number, len(kept))
            for record in _records(made, shape):
                writer.add(record)
        n = writer.n_episodes
        writer.finish({"train": f"0:{n - test}"} | ({"test": f"{n - test}:{n}"} if test else {}))
        how = _how(kept, options)
        write_json(dest / MADE, how)
        write_new_file(dest / "README.md", [card.text(shape, writer, options, test).encode()])
    progress("joined", len(kept), len(kept))
    return (*findings, *_incomplete(kept, shape))


def _about(part: Part) -> _Made:
    try:
        info = json.loads((part.path / "meta/info.json").read_bytes())
        choices = json.loads((part.path / MADE).read_bytes())
        features: dict[str, Any] = info["features"]
        views = {
            key: View(
                kind="depth" if feature["info"]["video.is_depth_map"] else "color",
                width=feature["shape"][1],
                height=feature["shape"][0],
            )
            for key, feature in features.items()
            if feature["dtype"] == "video"
        }
        state, action = (tuple(features[key]["names"]) if key in features else () for key in (STATE, ACTION))
        who = next((row["performer"] for row in _episodes(part.path) if row["performer"]), "")
    except (OSError, ValueError, KeyError, TypeError, pa.ArrowException) as error:
        raise _damaged(part, error) from error
    return _Made(part, state, action, views, info["total_episodes"], who, choices)


def _damaged(part: Part, error: Exception) -> CorruptError:
    return CorruptError(
        f"cannot join {part.label}",
        where=error.where if isinstance(error, FormatError) else f"{type(error).__name__}: {error}",
        consequence="the data set was not written",
        fix="remove the part, and export again",
    )


def _agreed(known: Sequence[_Made]) -> tuple[list[_Made], dict[str, View], list[str]]:
    """The parts that have all the cameras of most parts, these cameras, and what is left out."""
    votes = Counter(tuple(sorted(made.views.items(), key=lambda item: item[0])) for made in known)
    # the most frequent; of equally frequent ones the one with most cameras, then the first
    order = {views: number for number, views in reversed(list(enumerate(votes)))}
    chosen = dict(max(votes, key=lambda views: (votes[views], len(views), -order[views])))
    findings: list[str] = []
    kept: list[_Made] = []
    for made in known:
        lacks = [key for key, view in chosen.items() if made.views.get(key) != view]
        if lacks:
            findings.append(
                f"{made.part.label}: left out; it has not the same {', '.join(lacks)} as most sessions"
            )
            continue
        kept.append(made)
        if more := sorted(set(made.views) - set(chosen)):
            findings.append(f"{made.part.label}: {', '.join(more)} left out, which most sessions have not")
    return kept, chosen, findings


def _union(lists: Iterator[tuple[str, ...]]) -> tuple[str, ...]:
    """All names, in the order in which they first come."""
    return tuple(dict.fromkeys(name for names in lists for name in names))


def _incomplete(kept: Sequence[_Made], shape: Layout) -> Iterator[str]:
    for key, names in ((STATE, shape.state), (ACTION, shape.action)):
        for made in kept:
            lacks = [name for name in names if name not in (made.state if key == STATE else made.action)]
            if lacks:
                shown = ", ".join(lacks[:3]) + (", ..." if len(lacks) > 3 else "")
                yield f"{made.part.label}: {len(lacks)} numbers of {key} are zero and marked unknown: {shown}"


def _split(kept: list[_Made], options: LeRobotOptions) -> tuple[list[_Made], int]:
    """The parts with those of the split ``test`` last, and how many episodes these have.

    Which performers (or sessions) are in ``test`` follows from their names alone; who is not known by name is one.
    """
    if options.split == "none":
        return kept, 0
    group = {id(made): made.who if options.split == "performer" else made.part.label for made in kept}
    names = sorted(set(group.values()), key=lambda name: hashlib.sha256(name.encode()).digest())
    n = min(max(round(options.test_share * len(names)), 1), len(names) - 1)
    held_out = set(names[:n])
    ordered = sorted(kept, key=lambda made: group[id(made)] in held_out)
    return ordered, sum(made.n_episodes for made in kept if group[id(made)] in held_out)


def _how(kept: Sequence[_Made], options: LeRobotOptions) -> dict[str, Any]:
    """How the data set was made, for the record."""
    video: dict[str, Any] = {}
    worst: dict[str, float] = {}
    for made in kept:
        for key, said in made.choices["video"].items():
            counted = video.setdefault(key, {"episodes_copied": 0, "episodes_encoded": 0, "why": {}})
            for name in ("episodes_copied", "episodes_encoded"):
                counted[name] += said[name]
            for why, n in said["why"].items():
                counted["why"][why] = counted["why"].get(why, 0) + n
        for name, seconds in made.choices["worst_offset_s"].items():
            worst[name] = max(worst.get(name, 0.0), seconds)
    return {
        "clock": clock_method(options) | {"worst_offset_s": dict(sorted(worst.items()))},
        "video": video,
        "options": asdict(options),
        "sessions": [made.part.label for made in kept],
    }


# ------------------------------------------------------------------------------------------ reading parts


def _episodes(folder: Path) -> Iterator[dict[str, Any]]:
    """The rows of ``meta/episodes``, without statistics."""
    with pq.ParquetFile(folder / file_name("meta/episodes", 0)) as file:
        names = [name for name in file.schema_arrow.names if not name.startswith("stats/")]
        for group in range(file.num_row_groups):
            yield from file.read_row_group(group, columns=names).to_pylist()


def _records(made: _Made, shape: Layout) -> Iterator[Record]:
    """The episodes of a part, with the columns of the data set."""
    folder = made.part.path
    with ExitStack() as stack:
        try:
            private = stack.enter_context(pq.ParquetFile(folder / file_name(PRIVATE, 0)))
            notes = (
                row for n in range(private.num_row_groups) for row in private.read_row_group(n).to_pylist()
            )
            videos = {key: _Videos(folder, key, shape.fps, stack) for key in shape.views}
            for episode, note, rows in zip(_episodes(folder), notes, _row_groups(folder), strict=True):
                yield Record(
                    task=episode["tasks"][0],
                    n=episode["length"],
                    vectors=_vectors(rows, made, shape),
                    said=[Entry(*entry) for entry in json.loads(note["said"])],
                    clips={key: video.clip(episode, note) for key, video in videos.items()},
                    facts=Facts(**{name: episode[name] for name in Facts.__dataclass_fields__}),
                    sampled={key: _sampled(note, key, shape.views[key]) for key in videos},
                )
        except (FormatError, OSError, ValueError, KeyError, TypeError, pa.ArrowException) as error:
            raise _damaged(made.part, error) from error


def _row_groups(folder: Path) -> Iterator[pa.Table]:
    number = 0
    while (path := folder / file_name("data", number)).exists():
        with pq.ParquetFile(path) as file:
            names = [name for name in layout.VECTORS if name in file.schema_arrow.names]
            for group in range(file.num_row_groups):
                yield file.read_row_group(group, columns=names)
        number += 1


def _vectors(rows: pa.Table, made: _Made, shape: Layout) -> dict[str, NDArray[Any]]:
    """The vectors of an episode, each number where the data set has it; zero, or not known, where it is missing."""
    found: dict[str, NDArray[Any]] = {}
    for key, (dtype, names) in shape.vectors.items():
        own = made.state if key in {STATE, layout.STATE_KNOWN} else made.action
        values = np.zeros((rows.num_rows, len(names)), dtype)
        if own:
            column: Any = rows[key].combine_chunks()
            flat = column.flatten() if pa.types.is_fixed_size_list(column.type) else column
            at = [names.index(name) for name in own]
            values[:, at] = flat.to_numpy(zero_copy_only=False).reshape(rows.num_rows, -1)
        found[key] = values
    return found


def _sampled(note: dict[str, Any], key: str, view: View) -> Sampled:
    counts = np.array(note[f"{key}/counts"], np.int64)
    return Sampled(
        counts=counts.reshape(3 if view.kind == "color" else 1, -1), n_images=note[f"{key}/images"]
    )


class _Videos:
    """The videos of one camera of a part, whose files are open one at a time."""

    def __init__(self, folder: Path, key: str, fps: int, stack: ExitStack) -> None:
        self._folder, self._key, self._fps = folder, key, fps
        self._open = stack.enter_context(ExitStack())
        self._file: PacketFile | None = None
        self._path: Path | None = None
        self._next_pts = 0

    def clip(self, episode: dict[str, Any], note: dict[str, Any]) -> Clip:
        """The images of an episode."""
        at = f"videos/{self._key}"
        number = episode[f"{at}/chunk_index"] * layout.CHUNK_SIZE + episode[f"{at}/file_index"]
        path = self._folder / file_name(at, number, ".mp4")
        first_pts = round(episode[f"{at}/from_timestamp"] * self._fps) * TICKS
        follows = path == self._path and first_pts == self._next_pts
        if path != self._path or self._file is None:
            self._open.close()
            self._file, self._path = (
                self._open.enter_context(PacketFile(path, f"cannot copy {path.name}")),
                path,
            )
        self._next_pts = first_pts + episode["length"] * TICKS
        return Clip(
            file=self._file,
            first_pts=first_pts,
            count=episode["length"],
            follows=follows,
            n_bytes=note[f"{self._key}/bytes"],
        )
