"""All relations by QSRLib's names: what each is of, what it takes, and what its codes mean."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from learn.features.qsr import boxes, directions, distances, qtc
from learn.features.qsr.codes import Codes


@dataclass(frozen=True, kw_only=True)
class Relation:
    """A relation.

    Parameters
    ----------
    name : as in QSRLib.
    compute : the function, of as many objects as ``objects`` says and of ``parameters``.
    values : names of its codes; empty where the parameters give them.
    objects : how many it relates.
    frames : how many frames it looks at: 2 for movement, whose first value is that of the second frame.
    parameters : keyword arguments of ``compute``.
    of_boxes : whether sizes count.
    in_space : whether z counts.
    """

    name: str
    compute: Callable[..., Codes]
    values: tuple[str, ...] = ()
    objects: int = 2
    frames: int = 1
    parameters: tuple[str, ...] = ()
    of_boxes: bool = False
    in_space: bool = False

    @property
    def chains(self) -> bool:
        """Whether its values form chains, which can be collapsed and validated."""
        return self.name.startswith("qtc")

    def values_of(self, parameters: Mapping[str, Any]) -> tuple[str, ...]:
        """Names of the codes, given the parameters."""
        if self.name == "argd":
            return distances.argd_values(parameters["thresholds"])
        if self.name == "argprobd":
            return distances.argprobd_values(parameters["bands"])
        return self.values


_Q = ("threshold",)
_ALL = (
    Relation(name="cardir", compute=directions.cardir, values=directions.CARDIR),
    Relation(name="mos", compute=distances.mos, values=distances.MOS, objects=1, frames=2, parameters=_Q),
    Relation(name="argd", compute=distances.argd, parameters=("thresholds",), in_space=True),
    Relation(name="argprobd", compute=distances.argprobd, parameters=("bands", "generator")),
    Relation(name="qtcbs", compute=qtc.qtc_b, values=qtc.QTC_B, frames=2, parameters=_Q),
    Relation(name="qtccs", compute=qtc.qtc_c, values=qtc.QTC_C, frames=2, parameters=(*_Q, "angle")),
    Relation(
        name="qtcbcs",
        compute=qtc.qtc_bc,
        values=qtc.QTC_BC,
        frames=2,
        parameters=(*_Q, "angle", "distance"),
    ),
    Relation(name="rcc2", compute=boxes.rcc2, values=boxes.RCC2, parameters=_Q, of_boxes=True),
    Relation(name="rcc3", compute=boxes.rcc3, values=boxes.RCC3, parameters=_Q, of_boxes=True),
    Relation(name="rcc4", compute=boxes.rcc4, values=boxes.RCC4, parameters=_Q, of_boxes=True),
    Relation(name="rcc5", compute=boxes.rcc5, values=boxes.RCC5, parameters=_Q, of_boxes=True),
    Relation(name="rcc8", compute=boxes.rcc8, values=boxes.RCC8, parameters=_Q, of_boxes=True),
    Relation(name="ra", compute=boxes.ra, values=boxes.RA, of_boxes=True),
    Relation(name="mwe", compute=directions.mwe, values=directions.MWE),
    Relation(name="tpcc", compute=directions.tpcc, values=directions.TPCC, objects=3),
)
RELATIONS = {relation.name: relation for relation in _ALL}
