"""A plugin with made-up components, so that reading is tested without any real model."""

import sys
from collections.abc import Mapping
from typing import Any

from attrs import Factory, frozen

from opir_core.host.discovery import Selection
from opir_core.host.host import Host
from opir_core.plugin import (
    AtmosphereModel,
    BackgroundModel,
    ClassifierModel,
    ConfidenceModel,
    Constellation,
    DetectionModel,
    EventEncoder,
    NoConfig,
    SensorModel,
    SignatureModel,
    SinkModel,
    SourceModel,
    TargetModel,
    TrackerModel,
    flag,
    hookimpl,
    nested,
    number,
    text,
)


@frozen(kw_only=True)
class Place:
    lat_deg: float = number(help="latitude", unit="deg", minimum=-90.0, maximum=90.0)
    lon_deg: float = number(help="longitude", unit="deg", minimum=-180.0, maximum=180.0)
    height_m: float = number(help="height", unit="m", default=0.0)


@frozen(kw_only=True)
class Launch(Place):
    time_s: float = number(help="ignition", unit="s", default=0.0)


@frozen(kw_only=True)
class Ballistic:
    type: str = text(help="target type", choices=("ICBM", "IRBM", "SRBM"))
    launch: Launch = nested(help="where from")
    aim: Place = nested(help="where to")
    profile: str | None = text(help="class profile", default=None)
    burn_time_s: float | None = number(help="burn time", unit="s", above=0.0, default=None)


@frozen(kw_only=True)
class Scanner:
    orbital_slot_deg: float = number(help="slot", unit="deg", minimum=-180.0, maximum=180.0)
    scan_period_ms: float = number(help="period", unit="ms", above=0.0, default=200.0)
    rows: int = number(help="rows", minimum=1, maximum=64, default=8)
    is_spinning: bool = flag(help="whether it spins", default=True)
    detection_probability: Mapping[str, float] = nested(
        help="by target type", minimum=0.0, maximum=1.0, default=Factory(dict)
    )
    bands: tuple[str, ...] = nested(help="bands", default=("SWIR",))
    edges_um: tuple[float, float] | None = nested(
        help="band edges", unit="um", minimum=0.0, default=None
    )
    notes: Any = nested(help="anything", default=None)


@frozen(kw_only=True)
class Weights:
    band: float = number(help="weight", minimum=0.0, maximum=1.0, default=0.5)
    count: float = number(help="weight", minimum=0.0, maximum=1.0, default=0.5)

    def __attrs_post_init__(self):
        if abs(self.band + self.count - 1.0) > 1e-9:
            raise ValueError(f"the weights sum to {self.band + self.count:.10g}, not to 1")


@frozen(kw_only=True)
class Lines:
    path: str = text(help="file", default="events.jsonl")
    encoder: str = text(help="encoder", default="flat")


@frozen(kw_only=True)
class Flame:
    peak_w_sr: float = number(help="brightness", unit="W/sr", minimum=0.0, default=1e5)


@frozen(kw_only=True)
class Arc:
    window_s: float = number(help="memory", unit="s", above=0.0, default=10.0)


@hookimpl
def opir_sensor_models():
    presets = {
        "slow": {
            "scan_period_ms": 10_000,
            "bands": ("SWIR", "MWIR"),
            "detection_probability": {"ICBM": 0.5},
        },
        "broken": {"rows": 0.5},
    }
    yield SensorModel(name="SCANNER", summary="scans", config=Scanner, build=print, presets=presets)
    yield SensorModel(name="STARER", summary="stares", config=Scanner, build=print)


@hookimpl
def opir_constellations():
    satellites = [
        {"id": f"FLEET-{n}", "orbital_slot_deg": slot} for n, slot in ((1, -75.0), (2, 10))
    ]
    yield Constellation(
        name="FLEET", summary="two scanners", model="SCANNER", satellites=satellites
    )
    yield Constellation(
        name="ODD", summary="a bad id", model="SCANNER", satellites=[{"id": "not an id"}]
    )
    yield Constellation(
        name="LOST", summary="of no model", model="NOWHERE", satellites=[{"id": "LOST-1"}]
    )
    bent = [{"id": f"BENT-{n}", "orbital_slot_deg": 400.0} for n in (1, 2)]
    yield Constellation(name="BENT", summary="a bad slot", model="SCANNER", satellites=bent)


@hookimpl
def opir_target_models():
    yield TargetModel(name="ballistic", summary="boosts", config=Ballistic, build=print)


@hookimpl
def opir_detection_models():
    yield DetectionModel(name="constant", summary="constant", build=print)


@hookimpl
def opir_classifiers():
    yield ClassifierModel(name="paper", summary="paper", config=NoConfig, build=print)


@hookimpl
def opir_confidence_models():
    yield ConfidenceModel(name="weighted", summary="weighted", config=Weights, build=print)


@hookimpl
def opir_trackers():
    yield TrackerModel(name="none", summary="none", build=print)
    yield TrackerModel(name="arc", summary="arc", config=Arc, build=print)


@hookimpl
def opir_signature_models():
    yield SignatureModel(name="flame", summary="bright", config=Flame, build=print)


@hookimpl
def opir_source_models():
    yield SourceModel(name="fires", summary="burn", config=Flame, build=print)


@hookimpl
def opir_atmosphere_models():
    yield AtmosphereModel(name="clear", summary="clear", build=print)


@hookimpl
def opir_background_models():
    yield BackgroundModel(name="none", summary="dark", build=print)


@hookimpl
def opir_event_encoders():
    yield EventEncoder(name="flat", summary="flat", build=print)


@hookimpl
def opir_sinks():
    yield SinkModel(name="jsonl", summary="lines", config=Lines, build=print)
    yield SinkModel(name="null", summary="nowhere", build=print)


def fake_host(*plugins):
    """Return a host that offers this plugin and the given ones, and nothing else."""
    host = Host(Selection([]))
    for plugin in (sys.modules[__name__], *plugins):
        host.register(plugin)
    return host


def scanner_settings():
    return {
        "orbital_slot_deg": -75.5,
        "scan_period_ms": 200.0,
        "rows": 16,
        "is_spinning": False,
        "detection_probability": {"ICBM": 0.6, "SRBM": 0.25},
        "bands": ["SWIR", "MWIR"],
        "edges_um": [2.5, 4.75],
        "notes": {"owner": "range", "numbers": [1, 2.5]},
    }


def good_mapping():
    """Return a scene with every kind of block; every setting stands where `scene_mapping` puts
    it.
    """
    targets = [
        {
            "id": f"T{number}",
            "model": "ballistic",
            "type": "ICBM",
            "launch": {"lat_deg": 34.73, "lon_deg": -120.57, "height_m": 100.0, "time_s": 10.0},
            "aim": {"lat_deg": 9.0, "lon_deg": 167.7, "height_m": 12.5},
            "profile": None,
            "burn_time_s": 180.0,
        }
        for number in (1, 2)
    ]
    return {
        "scene": "test range",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 900.0,
        "seed": 7,
        "light_time": True,
        "forces": ["j2", {"drag": {"ballistic_coefficient_kg_m2": 2500.0, "exponential": None}}],
        "sensors": [
            {
                "constellation": "FLEET",
                "members": [{"id": "FLEET-1", "model": "SCANNER", **scanner_settings()}],
            },
            {"id": "S2", "model": "STARER", **scanner_settings()},
        ],
        "targets": targets,
        "detection": {"model": "constant"},
        "classification": {"model": "paper"},
        "confidence": {"model": "weighted", "band": 0.25, "count": 0.75},
        "tracker": {"model": "arc", "window_s": 10.0},
        "outputs": [{"jsonl": {"path": "events.jsonl", "encoder": "flat"}}, {"null": {}}],
    }
