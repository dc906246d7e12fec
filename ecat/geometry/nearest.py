"""Which of some moments is the nearest in time: how streams that each have a clock of their own find together."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def nearest_in_time(
    times: NDArray[np.int64],
    asked: NDArray[np.int64],
    *,
    within: float | None = None,
    later_on_tie: bool = False,
) -> NDArray[np.int64]:
    """For each moment asked for, the position of the nearest of ``times``; -1 where there is none.

    Parameters
    ----------
    times : int64[n], nanoseconds (or frames), not descending; may be empty.
    asked : int64[m], in the same unit, in any order.
    within : what is further away than this is none; by default nothing is too far away.
    later_on_tie : of two that are equally near take the later, as the annotator of 2018 did (ECAT 2018 file format
        §2.5), instead of the earlier.

    Returns
    -------
    int64[m].
    """
    if not len(times):
        return np.full(len(asked), -1, np.int64)
    after = np.minimum(np.searchsorted(times, asked), len(times) - 1)
    before = np.maximum(after - 1, 0)
    to_before, to_after = np.abs(asked - times[before]), np.abs(times[after] - asked)
    is_after = to_after <= to_before if later_on_tie else to_after < to_before
    found = np.where(is_after, after, before).astype(np.int64)
    if within is not None:
        found[np.abs(times[found] - asked) > within] = -1
    return found
