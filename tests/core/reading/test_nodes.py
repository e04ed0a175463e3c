"""Errors of a scene are reported in the order of their lines."""

from opir_core.reading import ordered
from opir_core.reading.nodes import Complaint


def test_errors_are_sorted_by_place() -> None:
    errors = [
        Complaint("no place"),
        Complaint("late", (1_000_000, 1)),
        Complaint("right", (3, 9)),
        Complaint("left", (3, 2)),
    ]
    assert [complaint.message for complaint in ordered([*errors, errors[0]])] == [
        "left",
        "right",
        "late",
        "no place",
    ]
