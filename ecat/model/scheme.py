"""The coding scheme: which tiers, event types, roles and predicates an annotation may use, and their constraints.

Tier constraints are those of ELAN and ANVIL (``included_in``, ``subdivision``, ``no_overlap``); predicate
constraints are those of ECAT (UNIQUE over arguments, EXCLUSIVE over unary predicates; ECAT 2018 file format
§1.10, §2.10).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Literal


def _children(tag: str) -> Any:
    return field(default=(), metadata={"tag": tag})


@dataclass(frozen=True, slots=True, kw_only=True)
class Tier:
    """A lane of events; ``parent`` and ``constraint`` say how it hangs below another."""

    name: str
    parent: str | None = None
    constraint: Literal["none", "included_in", "subdivision", "no_overlap"] = "none"


@dataclass(frozen=True, slots=True, kw_only=True)
class RoleType:
    """A role an event type may bind; ``required`` roles are reported when empty."""

    name: str
    kind: Literal["object", "joint", "event"] = "object"
    required: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class EventType:
    """A kind of event, the tier it lives on, its roles, and its VoxML program if there is one.

    ``key`` is the key of a keyboard that labels it, ``color`` is ``#rrggbb``.
    """

    name: str
    tier: str = ""
    voxml: str = ""
    key: str = ""
    color: str = ""
    roles: tuple[RoleType, ...] = _children("role")


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectType:
    """A kind of object: what an object's ``semantic_type`` may name; a VoxML entry in short.

    ``types`` are VoxML's (``physobj*artifact``), ``head`` and ``concavity`` say what it is shaped like, ``affordances``
    what can be done with it, one a line.
    """

    name: str
    types: str = ""
    head: str = ""
    concavity: str = ""
    affordances: str = field(default="", metadata={"element": True})


@dataclass(frozen=True, slots=True, kw_only=True)
class PredicateType:
    """A predicate over ``arity`` objects (``target`` = ``object``) or events (``event``)."""

    name: str
    arity: int = 2
    target: Literal["object", "event"] = "object"


@dataclass(frozen=True, slots=True, kw_only=True)
class Constraint:
    """Which facts exclude each other.

    UNIQUE: two positive facts of ``predicates[0]`` that agree in all arguments but number ``unique_argument`` (from 1).
    EXCLUSIVE: two different positive unary ``predicates`` (comma separated) on one object.
    """

    kind: Literal["UNIQUE", "EXCLUSIVE"]
    predicates: str
    unique_argument: int = 0

    @property
    def names(self) -> tuple[str, ...]:
        """The predicates' names."""
        return tuple(name.strip() for name in self.predicates.split(","))


@dataclass(frozen=True, slots=True, kw_only=True)
class CodingScheme:
    """A versioned list of what may be said; a ``closed`` one names every tier, type, role and predicate there is."""

    name: str
    version: str = "1"
    closed: bool = False
    tiers: tuple[Tier, ...] = _children("tier")
    event_types: tuple[EventType, ...] = _children("event_type")
    object_types: tuple[ObjectType, ...] = _children("object_type")
    predicates: tuple[PredicateType, ...] = _children("predicate")
    constraints: tuple[Constraint, ...] = _children("constraint")


_POSTURES = ("STAND", "SIT", "WALK", "RUN", "LIE", "CROUCH", "KNEEL")

ECAT_2018_SCHEME = CodingScheme(
    name="ecat-2018",
    tiers=(Tier(name="event"), Tier(name="sub-event", parent="event", constraint="included_in")),
    predicates=(
        *(PredicateType(name=n) for n in ("PART_OF", "LOOK_AT", "POINT_AT", "SUPPORT", "IDENTITY")),
        *(PredicateType(name=n, arity=1) for n in _POSTURES),
        *(PredicateType(name=n, target="event") for n in ("SUBEVENT", "CAUSE")),
    ),
    constraints=(
        Constraint(kind="UNIQUE", predicates="LOOK_AT", unique_argument=2),
        Constraint(kind="UNIQUE", predicates="POINT_AT", unique_argument=2),
        Constraint(kind="EXCLUSIVE", predicates=",".join(_POSTURES)),
    ),
)
"""The predicates and constraints that ECAT was shipped with (ECAT 2018 file format §1.10)."""

_SLIDE = (RoleType(name="Agent"), RoleType(name="Theme", required=True), RoleType(name="Landmark"))
_PART = (RoleType(name="Agent", kind="joint"), RoleType(name="Theme", required=True))

BLOCKS_SCHEME = CodingScheme(
    name="blocks",
    tiers=ECAT_2018_SCHEME.tiers,
    event_types=(
        *(
            EventType(name=f"slide_{way}", tier="event", voxml="slide", key=key, color=color, roles=_SLIDE)
            for way, key, color in (
                ("next", "5", "#4477aa"),
                ("past", "6", "#66ccee"),
                ("around", "7", "#228833"),
                ("toward", "8", "#ccbb44"),
                ("away", "9", "#ee6677"),
            )
        ),
        *(
            EventType(name=part, tier="sub-event", voxml=part, key=key, color=color, roles=_PART)
            for part, key, color in (
                ("grasp", "1", "#88ccee"),
                ("hold", "2", "#ddcc77"),
                ("move", "3", "#117733"),
                ("release", "4", "#cc6677"),
            )
        ),
    ),
    predicates=(
        *(PredicateType(name=n) for n in ("ON", "TOUCHING", "NEAR", "IDENTITY")),
        *(PredicateType(name=n, target="event") for n in ("SUBEVENT", "CAUSE")),
    ),
)
"""One block moved beside another: the actions, their parts, and who does what to what next to what."""

BUILT_IN_SCHEMES = {
    scheme.name: scheme
    for scheme in (
        ECAT_2018_SCHEME,
        BLOCKS_SCHEME,
        # the annotations of generated sessions name it
        replace(BLOCKS_SCHEME, name="ecat-sample"),
    )
}
"""The coding schemes that need no file, by name."""
