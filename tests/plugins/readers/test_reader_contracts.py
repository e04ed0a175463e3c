"""Targets from files keep the contract of their kind."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from opir_testing import ReaderContract, TargetContract
from repository import DATA


class TestCsv(ReaderContract):
    name = "csv"


class TestOem(ReaderContract):
    name = "oem"


class TestStk(ReaderContract):
    name = "stk"


class TestEvents(ReaderContract):
    name = "events"


class TestSights(ReaderContract):
    name = "sights"


class TestTdm(ReaderContract):
    name = "tdm"


FLIGHTS = DATA / "flights"


class TestTables(TargetContract):
    name = "table"
    launches: ClassVar[Sequence[Mapping[str, Any]]] = (
        {"id": "IN-VIEW", "type": "ICBM", "file": str(FLIGHTS / "in_view.csv")},
        {"id": "ANTIMERIDIAN", "type": "SRBM", "file": str(FLIGHTS / "antimeridian.csv")},
    )
