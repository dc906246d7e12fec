"""The bones of a body."""

from __future__ import annotations

from ecat.model.skeleton import BONES


def test_the_bones_of_the_25_joints_make_one_tree() -> None:
    joints = {joint for bone in BONES for joint in bone}
    assert len(joints) == 25
    assert len(BONES) == 24
    reached, edge = {"SpineBase"}, {"SpineBase"}
    while edge:
        edge = {b if a in edge else a for a, b in BONES if (a in edge) != (b in edge)} - reached
        reached |= edge
    assert reached == joints
