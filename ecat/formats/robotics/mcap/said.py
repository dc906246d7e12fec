"""What was said of a session, as ``foxglove.Event``: one for each stretch of an event, one for each relation."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ecat.formats.robotics.mcap import messages
from ecat.formats.robotics.mcap.messages import Item
from ecat.formats.robotics.scene import Things, relations_of, span_ns, who
from ecat.model import Layer
from ecat.model.annotation import Event
from ecat.store import Session

Said: TypeAlias = tuple[int, int, dict[str, str]]
"""From when to when, half-open, ns since the session's start; and what."""


def messages_of(said: Iterable[Said], topic: str, shift_ns: int) -> Iterator[Item]:
    """Messages in the order of their beginnings, at which they are logged."""
    for start, end, facts in sorted(said, key=lambda item: item[:2]):
        yield start + shift_ns, topic, messages.event(start + shift_ns, end + shift_ns, facts)


def events(layer: Layer, things: Things, times: NDArray[np.int64]) -> Iterator[Said]:
    """The stretches of a layer's events."""
    for event in layer.events:
        facts, n = _facts(event, things), len(event.segments)
        for k, segment in enumerate(event.segments, 1):
            yield (*span_ns(segment, times), facts | ({"segment": f"{k}/{n}"} if n > 1 else {}))


def _facts(event: Event, things: Things) -> dict[str, str]:
    links: dict[str, list[str]] = defaultdict(list)
    for link in event.links:
        links[f"link:{link.type}"].append(link.target)
    return (
        {name: getattr(event, name) or "" for name in ("id", "type", "text", "tier", "parent", "status")}
        | {"author": event.author, "unsure": "true" if event.unsure else ""}
        | {f"role:{role}": name for role, name in who(event, things).items()}
        | {name: ", ".join(targets) for name, targets in links.items()}
        | {f"property:{known.name}": known.value for known in event.properties}
    )


def relations(session: Session, layer: str, things: Things, times: NDArray[np.int64]) -> Iterator[Said]:
    """The relations of a layer, each from when to when it holds, or is denied."""
    for held in relations_of(session, layer, things, times):
        facts = {
            "predicate": held.predicate,
            "arguments": ", ".join(held.arguments),
            "polarity": "holds" if held.polarity else "denied",
            "source": held.source,
            "status": held.status,
        }
        yield held.start_ns, held.end_ns, facts
