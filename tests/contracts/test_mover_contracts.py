"""Sources that move or flash keep the contract of sources."""

from collections.abc import Mapping
from typing import Any, ClassVar

from opir_testing import SourceContract

PLACES = [{"lat_deg": 10.0, "lon_deg": 20.0}, {"lat_deg": -5.0, "lon_deg": 179.99}]
REGION = {"south_deg": -5.0, "north_deg": 5.0, "west_deg": 175.0, "east_deg": -175.0}


class TestShips(SourceContract):
    name = "ships"
    settings: ClassVar[Mapping[str, Any]] = {"field": {"region": REGION, "per_million_km2": 4.0}}


class TestTrains(SourceContract):
    name = "trains"
    settings: ClassVar[Mapping[str, Any]] = {"at": PLACES}


class TestFireFronts(SourceContract):
    name = "fire_fronts"
    settings: ClassVar[Mapping[str, Any]] = {"at": PLACES}


class TestBalloons(SourceContract):
    name = "balloons"
    settings: ClassVar[Mapping[str, Any]] = {"at": PLACES}


class TestSatellites(SourceContract):
    name = "satellites"
    settings: ClassVar[Mapping[str, Any]] = {"at": PLACES}


class TestAircraft(SourceContract):
    name = "aircraft"
    settings: ClassVar[Mapping[str, Any]] = {
        "at": PLACES,
        "legs": [
            {"for_s": 10.0, "climb_m_s": 50.0, "afterburner": True},
            {"for_s": 10.0, "bank_deg": -40.0},
        ],
    }


class TestReentries(SourceContract):
    name = "reentries"
    settings: ClassVar[Mapping[str, Any]] = {"at": PLACES}


class TestGrazers(SourceContract):
    name = "grazers"
    settings: ClassVar[Mapping[str, Any]] = {"at": PLACES}


class TestStorms(SourceContract):
    name = "storms"
    settings: ClassVar[Mapping[str, Any]] = {"at": PLACES}
