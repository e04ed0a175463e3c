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


FLIGHTS = DATA / "flights"


class TestTables(TargetContract):
    name = "table"
    launches: ClassVar[Sequence[Mapping[str, Any]]] = (
        {"id": "IN-VIEW", "type": "ICBM", "file": str(FLIGHTS / "in_view.csv")},
        {"id": "ANTIMERIDIAN", "type": "SRBM", "file": str(FLIGHTS / "antimeridian.csv")},
    )


class TestAscents(TargetContract):
    name = "ascent"
    launches: ClassVar[Sequence[Mapping[str, Any]]] = (
        {"id": "EAST", "lat_deg": 28.6, "lon_deg": -80.6, "time_s": 5.0},
        {"id": "POLAR", "lat_deg": 34.7, "lon_deg": -120.6, "azimuth_deg": 190.0, "orbit_altitude_km": 300.0},
        {"id": "BACK", "lat_deg": 28.6, "lon_deg": -80.6, "flight": "booster", "flies_back": False},
    )
