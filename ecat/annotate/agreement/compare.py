"""How far the layers of two or more annotators agree: the figures, added up over pairs and sessions.

Times are frames, as the annotators saw them.  What is compared:

* **labels by frame**: on each tier the types that go on at a frame are one label (``hold``, ``hold+move`` or nothing);
  and for every type whether it goes on.  Kappa and alpha follow from these.
* **events**: paired one to one by type and overlap (:func:`ecat.annotate.agreement.spans.match_spans`); F1 at several
  least overlaps, the errors of the edges, whether the parents of paired sub-events are paired too, and the roles.
* **objects**: paired by where they were drawn (:func:`ecat.annotate.agreement.objects.match_objects`).
* **relations**: facts about paired objects, by predicate.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np

from ecat.annotate.agreement.facts import depths, event_spans, last_frame, relation_spans
from ecat.annotate.agreement.objects import match_objects
from ecat.annotate.agreement.spans import Match, Score, Span, edge_errors, match_spans
from ecat.model import Event, Layer
from ecat.model.scheme import ECAT_2018_SCHEME, CodingScheme

LEAST_IOUS = (0.25, 0.5, 0.75)
UNTYPED = "(no type)"
PAIRING_IOU = 0.5
"""Of the pairs whose edges, parents and roles are compared."""
Counts: TypeAlias = Counter[tuple[Any, ...]]


def _counters() -> dict[str, Counts]:
    return {}


def _scores() -> dict[tuple[str, str, float], Score]:
    return {}


@dataclass(slots=True)
class Agreement:
    """Figures of one or more sessions, as sums; :mod:`ecat.annotate.agreement.report` makes coefficients of them.

    Attributes
    ----------
    labels : patterns of labels by frame (:mod:`ecat.annotate.agreement.ratings`), by tier.
    types : patterns of whether it goes on, by type.
    spans : scores by what they group (``all``, ``type``, ``tier``, ``depth``), its name, and the least overlap.
    edges : by tier, frames that the second's start and end are later, a row per pair.
    parents, roles, objects, relations : scores; roles by role, relations by predicate.
    object_ious : of the pairs of drawn objects. names : of those pairs that have the same name, and of all.
    """

    raters: tuple[str, ...]
    sessions: int = 0
    frames: int = 0
    labels: dict[str, Counts] = field(default_factory=_counters)
    types: dict[str, Counts] = field(default_factory=_counters)
    spans: dict[tuple[str, str, float], Score] = field(default_factory=_scores)
    edges: dict[str, list[tuple[int, int]]] = field(default_factory=dict[str, list[tuple[int, int]]])
    parents: Score = field(default_factory=Score)
    roles: dict[str, Score] = field(default_factory=dict[str, Score])
    objects: Score = field(default_factory=Score)
    object_ious: list[float] = field(default_factory=list[float])
    names: Score = field(default_factory=Score)
    relations: dict[str, Score] = field(default_factory=dict[str, Score])

    def add(
        self,
        layers: Sequence[Layer],
        n_frames: int = 0,
        scheme: CodingScheme = ECAT_2018_SCHEME,
        *,
        elsewhere: Mapping[tuple[int, int], Mapping[str, str]] = MappingProxyType({}),
    ) -> None:
        """Count in one session.

        Parameters
        ----------
        layers : one per rater, in the raters' order. n_frames : 0 is an unknown length. elsewhere : by the places of
            two raters, which objects of other sessions are the same (``<session>/<object id>``).
        """
        n_frames = n_frames or last_frame(layers)
        self.sessions += 1
        self.frames += n_frames
        spans = [event_spans(layer, n_frames) for layer in layers]
        self._add_labels(layers, spans, n_frames)
        for i, j in combinations(range(len(layers)), 2):
            paired = match_objects(layers[i].objects, layers[j].objects)
            self._add_objects(layers[i], layers[j], paired)
            self._add_events((layers[i], layers[j]), (spans[i], spans[j]), _names(paired))
            same = {**elsewhere.get((i, j), {}), **_names(paired)}
            self._add_relations(layers[i], layers[j], scheme, n_frames, same)

    def _add_labels(self, layers: Sequence[Layer], spans: Sequence[Sequence[Span]], n_frames: int) -> None:
        tier = [{event.id: event.tier for event in layer.events} for layer in layers]
        for name in sorted({t for by_id in tier for t in by_id.values()}):
            of_tier = [
                [s for s in mine if by_id[s.id] == name] for mine, by_id in zip(spans, tier, strict=True)
            ]
            self.labels.setdefault(name, Counter()).update(frame_patterns(of_tier, n_frames, _joined))
        for label in sorted({str(s.label) for mine in spans for s in mine}):
            of_type = [[s for s in mine if s.label == label] for mine in spans]
            self.types.setdefault(label, Counter()).update(frame_patterns(of_type, n_frames, bool))

    def _add_events(
        self, layers: tuple[Layer, Layer], spans: tuple[list[Span], list[Span]], same: Mapping[str, str]
    ) -> None:
        events = tuple({event.id: event for event in layer.events} for layer in layers)
        depth = tuple(map(depths, events))
        for least in LEAST_IOUS:
            matches = match_spans(*spans, least_iou=least)
            self._add_scores(least, spans, matches, lambda _k, _s: ("all", "all"))
            self._add_scores(least, spans, matches, lambda _k, s: ("type", str(s.label)))
            self._add_scores(least, spans, matches, lambda k, s: ("tier", events[k][s.id].tier))
            self._add_scores(least, spans, matches, lambda k, s: ("depth", str(depth[k][s.id])))
        matches = match_spans(*spans, least_iou=PAIRING_IOU)
        errors = edge_errors(*spans, matches).tolist()
        for match, (start, end) in zip(matches, errors, strict=True):
            tier = events[0][spans[0][match.first].id].tier
            self.edges.setdefault(tier, []).append((start, end))
        pairs = {spans[0][m.first].id: spans[1][m.second].id for m in matches}
        for a, b in pairs.items():
            self._add_pair(events[0][a], events[1][b], pairs, same)

    def _add_scores(
        self,
        least: float,
        spans: tuple[list[Span], list[Span]],
        matches: Iterable[Match],
        group: Callable[[int, Span], tuple[str, str]],
    ) -> None:
        matched = Counter(group(0, spans[0][m.first]) for m in matches)
        first, second = (Counter(group(k, span) for span in spans[k]) for k in (0, 1))
        for key in sorted(first.keys() | second.keys()):
            score = Score(matched[key], first[key], second[key])
            self.spans[*key, least] = self.spans.get((*key, least), Score()) + score

    def _add_pair(self, a: Event, b: Event, pairs: Mapping[str, str], same: Mapping[str, str]) -> None:
        if a.parent is not None or b.parent is not None:
            agreed = a.parent is not None and pairs.get(a.parent) == b.parent
            self.parents += Score(int(agreed), int(a.parent is not None), int(b.parent is not None))
        first = {role.name: same.get(role.target, role.target) for role in a.roles}
        second = {role.name: role.target for role in b.roles}
        for name in sorted(first.keys() | second.keys()):
            agreed = name in first and first[name] == second.get(name)
            score = Score(int(agreed), int(name in first), int(name in second))
            self.roles[name] = self.roles.get(name, Score()) + score

    def _add_objects(self, first: Layer, second: Layer, paired: Mapping[str, tuple[str, float]]) -> None:
        self.objects += Score(len(paired), len(first.objects), len(second.objects))
        things = {thing.id: thing for thing in first.objects}, {thing.id: thing for thing in second.objects}
        for a, (b, alike) in paired.items():
            if things[0][a].key_frames:
                self.object_ious.append(alike)
            equal = things[0][a].name.casefold() == things[1][b].name.casefold()
            self.names += Score(int(equal), 1, 1)

    def _add_relations(
        self, first: Layer, second: Layer, scheme: CodingScheme, n_frames: int, same: Mapping[str, str]
    ) -> None:
        spans = (
            relation_spans(first, scheme, n_frames, same),
            relation_spans(second, scheme, n_frames, {}),
        )
        matches = match_spans(*spans, least_iou=PAIRING_IOU)

        def predicate(span: Span) -> str:
            return str(span.label[0]) if isinstance(span.label, tuple) else ""  # pyright: ignore[reportUnknownArgumentType]

        matched = Counter(predicate(spans[0][m.first]) for m in matches)
        counts = tuple(Counter(map(predicate, side)) for side in spans)
        for name in sorted(counts[0].keys() | counts[1].keys()):
            score = Score(matched[name], counts[0][name], counts[1][name])
            self.relations[name] = self.relations.get(name, Score()) + score


def _names(paired: Mapping[str, tuple[str, float]]) -> dict[str, str]:
    return {a: b for a, (b, _) in paired.items()}


def _joined(labels: set[str]) -> str:
    # an event without a type is not the same as no event
    return "+".join(sorted(label or UNTYPED for label in labels))


def frame_patterns(
    spans: Sequence[Sequence[Span]], n_frames: int, label: Callable[[set[str]], Any]
) -> Counts:
    """How many frames got which labels from the raters; ``label`` makes one of all that go on at a frame."""
    edges = {0, n_frames} | {edge for mine in spans for span in mine for s in span.stretches for edge in s}
    at = np.array(sorted(edge for edge in edges if edge <= n_frames), np.int64)
    going: list[list[set[str]]] = []
    for mine in spans:
        labels: list[set[str]] = [set() for _ in at[1:]]
        for span in mine:
            for start, end in span.stretches:
                low, high = np.searchsorted(at, (start, end))
                for slot in labels[int(low) : int(high)]:
                    slot.add(str(span.label))
        going.append(labels)
    found: Counts = Counter()
    for frames, *together in zip(np.diff(at).tolist(), *going, strict=True):
        found[tuple(map(label, together))] += frames
    return found
