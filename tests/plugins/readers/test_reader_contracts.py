"""Every reader that opir_readers offers passes the conformance tests, and so do its targets."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import pytest
from opir_testing import ReaderContract, TargetContract
from read_files import READER, read
from repository import DATA

SITE = {"lat_deg": 34.73, "lon_deg": -120.57, "height_m": 100.0, "azimuth_deg": 270.0}
FLIGHTS = DATA / "flights"

#: Readers of local places alone, which need a launch point.
LOCAL = ("rasaero", "webcast")


class TestReaders(ReaderContract):
    @pytest.fixture(autouse=True, params=READER)
    def named(self, request: pytest.FixtureRequest) -> None:
        type(self).name = request.param

    @classmethod
    def read(cls, text: str) -> Any:
        return read(cls.name, text, 0, **({"site": SITE} if cls.name in LOCAL else {}))


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
        {
            "id": "POLAR",
            "lat_deg": 34.7,
            "lon_deg": -120.6,
            "azimuth_deg": 190.0,
            "orbit_altitude_km": 300.0,
        },
        {"id": "BACK", "lat_deg": 28.6, "lon_deg": -80.6, "flight": "booster", "flies_back": False},
    )
