"""Sources that move or flash keep the contract of sources."""

from collections.abc import Mapping
from typing import Any, ClassVar

from opir_testing import SourceContract

import opir_core as opir

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


def launched(name: str) -> Any:
    """Return the flight of a glider that is launched 10 s into a scene, and its row."""
    assert name == "G"
    glider = {
        "id": "G",
        "type": "HGV",
        "launch": {"lat_deg": 20.0, "lon_deg": 140.0, "time_s": 10.0},
        "aim": {"lat_deg": 45.0, "lon_deg": -140.0},
    }
    sensor = {"model": "SBIRS-GEO", "id": "S", "orbital_slot_deg": 160.0}
    scene = {
        "scene": "stages",
        "epoch": "2026-03-01T12:00:00Z",
        "duration_s": 600,
        "seed": 4,
        "sensors": [sensor],
        "targets": [glider],
        "outputs": [],
    }
    return opir.compile_plan(opir.scene_from_mapping(scene)).targets.trajectories[0], 0


class TestSpentStages(SourceContract):
    name = "spent_stages"
    settings: ClassVar[Mapping[str, Any]] = {"launch": "G", "stages": 4}
    launched = staticmethod(launched)


class TestGrazers(SourceContract):
    name = "grazers"
    settings: ClassVar[Mapping[str, Any]] = {"at": PLACES}


class TestStorms(SourceContract):
    name = "storms"
    settings: ClassVar[Mapping[str, Any]] = {"at": PLACES}
