"""What may have been meant by an id that is not there."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from itertools import islice
from typing import Any, Literal

from ecat.model import AnnotatedObject, Event
from ecat.model.document import Document

Listed = Literal["object", "event", "relation"]
LISTED: tuple[Listed, ...] = ("object", "event", "relation")
"""The kinds of elements that people name by an id, each with a verb that lists them."""
_MOST = 2000
"""Elements that are compared."""
_SHOWN = 3


def advice(document: Document, kinds: Sequence[Listed], name: str) -> str:
    """What to do where ``name`` is the id of no element of these kinds."""
    other = next((kind for kind in LISTED if document.element(kind, name) is not None), None)
    said = f"{name} is {_a(other)}; " if other else ""
    if meant := near(document, kinds, name):
        said += f"did you mean {meant}? "
    there = [kind for kind in kinds if document.ids(kind)]
    layer = "" if document.name == "main" else f" --layer {shlex.quote(document.name)}"
    if there:
        return f"{said}ecat {there[0]} list MY_SESSION{layer} shows those that there are"
    return f"{said}there is none yet: ecat {kinds[0]} add MY_SESSION{layer} ... adds one"


def near(document: Document, kinds: Sequence[Listed], name: str) -> str:
    """The elements that are called nearly so, with what people call them: ``o2 (mug) or o5 (jug)``."""
    labels = {
        id_: _label(document.element(kind, id_))
        for kind in kinds
        for id_ in islice(document.ids(kind), _MOST)
    }
    found = list(islice(_alike(labels, name), _SHOWN))
    return " or ".join(f"{id_} ({labels[id_]})" if labels[id_] else id_ for id_ in found)


def _alike(labels: dict[str, str], name: str) -> Iterator[str]:
    """Ids by how near they are: what is called so, what is called nearly so, what has nearly that id."""
    wanted = name.strip().casefold()
    called: dict[str, list[str]] = {}
    for id_, label in labels.items():
        if label:
            called.setdefault(label.casefold(), []).append(id_)
    # among ids that are numbers every other one is near
    ids = {id_.casefold(): id_ for id_ in labels if not id_[1:].isdigit()}
    plain = [id_ for id_ in labels if id_.casefold() == wanted]
    words = [id_ for label in get_close_matches(wanted, called, _SHOWN, 0.7) for id_ in called[label]]
    yield from dict.fromkeys([*plain, *words, *(ids[i] for i in get_close_matches(wanted, ids, _SHOWN, 0.7))])


def _label(element: Any) -> str:
    """What people call an element."""
    if isinstance(element, AnnotatedObject):
        return element.name
    said = element.type or element.text if isinstance(element, Event) else element.predicate
    return " ".join(said.split())[:40]


def _a(kind: str) -> str:
    return f"a {kind}" if kind == "relation" else f"an {kind}"
