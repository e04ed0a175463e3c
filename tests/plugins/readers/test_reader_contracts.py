"""Targets from files keep the contract of their kind."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

from opir_readers.configs_of_sites import SiteConfig
from opir_testing import ReaderContract, TargetContract
from repository import DATA

from opir_core.plugin import ReaderContext


class TestCsv(ReaderContract):
    name = "csv"


class TestOem(ReaderContract):
    name = "oem"


class TestStk(ReaderContract):
    name = "stk"


class TestGpx(ReaderContract):
    name = "gpx"


class TestKml(ReaderContract):
    name = "kml"


class TestOemXml(ReaderContract):
    name = "oem-xml"


class TestOmm(ReaderContract):
    name = "omm"


class TestTle(ReaderContract):
    name = "tle"


class TestSp3(ReaderContract):
    name = "sp3"


SITE = SiteConfig(lat_deg=34.73, lon_deg=-120.57, height_m=100.0, azimuth_deg=270.0)


class TestOpenRocket(ReaderContract):
    name = "openrocket"


class TestRocketPy(ReaderContract):
    name = "rocketpy"


class AtSite:
    """A reader of local places, with a launch point."""

    component: ClassVar[Callable[[], Any]]

    @classmethod
    def read(cls, text: str) -> Any:
        config = cls.component().config(site=SITE)
        return cls.component().build(config, ReaderContext(text=text))


class TestRasAero(AtSite, ReaderContract):
    name = "rasaero"


class TestWebcast(AtSite, ReaderContract):
    name = "webcast"


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
