"""What is found wrong with the rows of tables."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ecat.check import examine

if TYPE_CHECKING:
    from conftest import Case


def test_values_that_the_column_does_not_have(case: Case) -> None:
    def guess(columns: dict[str, Any]) -> None:
        columns["source"][4] = "guessed"

    case.change("poses", guess)
    (finding,) = examine(case.patient)
    assert (finding.severity, finding.code, finding.place) == ("error", "table-value", "table poses")
    assert finding.message == "column source has guessed; expected interpolated, observed"


def test_rows_that_are_not_sorted_by_time(case: Case) -> None:
    def swap(columns: dict[str, Any]) -> None:
        for cells in columns.values():
            cells[50:52], cells[52:54] = cells[52:54], cells[50:52]

    case.change("markers_2d", swap)
    (finding,) = examine(case.patient)
    assert (finding.severity, finding.code, finding.place) == ("error", "table-unsorted", "table markers_2d")
