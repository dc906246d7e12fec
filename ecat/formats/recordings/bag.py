"""Bags of messages, opened anew for every pass through them, by whatever name their faults have."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from ecat.errors import FormatError, os_error
from ecat.formats.recordings.ros_messages import fits


class Bag:
    """A ROS 1 or ROS 2 bag.

    Attributes
    ----------
    notes : what was odd. types, counts : of every topic, the type and the number of its messages.

    Raises
    ------
    FormatError : not a bag, or one whose index is damaged.
    StoreError : it cannot be opened.
    """

    def __init__(self, path: Path, what: str) -> None:
        self.path, self.what = path, what
        self.notes: list[str] = []
        self.types: dict[str, str] = {}
        self.counts: dict[str, int] = {}
        with ExitStack() as stack:
            reader = self._open(stack)
            for connection in reader.connections:
                if not isinstance(connection.topic, str):  # a damaged database has cells of any type
                    continue
                self.types[connection.topic] = connection.msgtype
                self.counts[connection.topic] = self.counts.get(connection.topic, 0) + connection.msgcount
            self.is_big_endian_possible = reader.is2

    def _open(self, stack: ExitStack) -> Any:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        try:
            store = get_typestore(Stores.ROS2_HUMBLE)
            return stack.enter_context(AnyReader([self.path], default_typestore=store))
        except OSError as error:
            raise os_error(error, self.what, self.path) from error
        except Exception as error:  # a damaged bag makes the library fail in many ways
            fix = "`rosbag reindex` (ROS 1) or `ros2 bag reindex` mends a bag whose recorder was stopped hard"
            where = _reason(error)
            if "Profile is not ros2" in where:
                where = "an MCAP file without ROS messages, as `ecat export --format mcap` and Foxglove write them"
                fix = "ecat reads MCAP files that ROS 2 recorded; import what this one was made from"
            raise FormatError(self.what, where=f"{self.path.name}: {where}", fix=fix) from error

    def messages(self, topics: Sequence[str], *, raw: bool = False) -> Iterator[tuple[str, int, Any]]:
        """Topic, recorder's time in ns, and message (``raw``: its bytes), in the order of the recorder's times.

        Where the bag cannot be read any further, the messages end and a note says so.  A message that does not fit its
        type is None.
        """
        with ExitStack() as stack:
            reader = self._open(stack)
            connections = [c for c in reader.connections if c.topic in topics]
            n = 0
            if not connections:
                return
            found = reader.messages(connections=connections)
            while True:
                try:
                    item = next(found, None)
                except Exception as error:  # noqa: BLE001  (as above)
                    note = (
                        f"the bag is damaged: {_reason(error)}; {n} messages of {', '.join(topics)} were read"
                    )
                    self.notes.append(note)
                    return
                if item is None:
                    return
                n += 1
                connection, t_ns, data = item
                yield connection.topic, t_ns, data if raw else self._message(reader, connection, data)

    @staticmethod
    def _message(reader: Any, connection: Any, data: bytes) -> Any:
        try:
            message = reader.deserialize(data, connection.msgtype)
        except Exception:  # noqa: BLE001  (as above)
            return None
        return message if fits(message, connection.msgtype) else None

    def first(self, topic: str) -> Any:
        """The first message of a topic that can be read, or None."""
        return next((message for _, _, message in self.messages([topic]) if message is not None), None)

    def of_type(self, kind: str) -> list[str]:
        """Topics of a message type that have messages."""
        return sorted(name for name, of in self.types.items() if of == kind and self.counts[name])


def _reason(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"[:300]
