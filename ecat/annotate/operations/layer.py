"""Operations on a layer as a whole: its coding scheme, and windows all along the recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ecat.annotate.operations.base import Edit, Operation
from ecat.annotate.operations.events import remove_tree, type_tier
from ecat.annotate.operations.spans import spans_of
from ecat.model import Event

MOST_WINDOWS = 100_000


@dataclass(frozen=True, slots=True, kw_only=True)
class SetScheme(Operation):
    """Let the layer follow a coding scheme, or none (an empty name)."""

    name: str

    def perform(self, edit: Edit) -> None:
        """Set it."""
        edit.scheme = edit.find_scheme(self.name) if self.name else None
        edit.set_header(scheme=self.name)


@dataclass(frozen=True, slots=True, kw_only=True)
class AddWindows(Operation):
    """Events of ``duration`` frames, one every ``step`` frames from ``start`` on, as many as it holds (§2.13).

    Where an event with the very same span is there already, the window is added beside it (``add``), or not (``skip``),
    or in its place (``replace``); ``clear`` removes all events of that tier first.  Windows of no tier are beside
    events of no tier.
    """

    start: int
    step: int
    duration: int
    type: str = ""
    text: str = ""
    tier: str = ""
    existing: Literal["add", "replace", "skip", "clear"] = "add"

    def perform(self, edit: Edit) -> None:
        """Add them."""
        tier = self.tier or type_tier(edit, self.type)
        if self.existing == "clear":
            for name in list(edit.document.ids("event")):
                event = edit.document.event(name)
                if event is not None and event.tier == tier:
                    remove_tree(edit, name)
        spans = [(start, start + self.duration) for start in self._starts(edit)]
        if self.existing in {"skip", "replace"}:
            spans = [pair for pair in spans if self._is_free(edit, tier, pair)]
        for name, pair in zip(edit.new_ids("event", len(spans)), spans, strict=True):
            edit.put(
                Event(
                    id=name, type=self.type, tier=tier, text=self.text, author=edit.author,
                    segments=(edit.segment(*pair),),
                )
            )  # fmt: skip

    def _is_free(self, edit: Edit, tier: str, pair: tuple[int, int]) -> bool:
        """Whether a window is to be added where there may be one already, which is removed if it is to be replaced."""
        same = [event.id for event in edit.document.overlapping(tier, *pair) if spans_of(event) == [pair]]
        for name in same if self.existing == "replace" else ():
            if edit.document.event(name) is not None:
                remove_tree(edit, name)
        return not same or self.existing == "replace"

    def _starts(self, edit: Edit) -> range:
        if not edit.n_frames:
            raise edit.refusal("nobody knows how long the recording is", "add the events one by one")
        if self.step < 1 or self.duration < 1 or self.start < 0:
            raise edit.refusal(
                f"windows from {self.start}, every {self.step}, of {self.duration} frames",
                "let start be 0 or more, step and duration 1 or more",
            )
        starts = range(self.start, edit.n_frames - self.duration + 1, self.step)
        if not starts:
            raise edit.refusal(
                f"no window of {self.duration} frames from {self.start} on fits into {edit.n_frames} frames",
                "take shorter ones",
            )
        if len(starts) > MOST_WINDOWS:
            raise edit.refusal(
                f"{len(starts):,} windows, at most {MOST_WINDOWS:,} are added at once", "take a larger step"
            )
        return starts
