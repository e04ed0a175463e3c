"""The objects of `discrimination.py`: launches and hot sources drawn at random, and the looks that
are judged.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from opir_photons.radiometry.plume import plume_table

import opir_core as opir
from opir_core.arrays import FloatArray
from opir_core.flight.boost import boost_profile
from opir_core.scene import core_target_class
from opir_core.scene.scene import REPORTED_TYPES, TARGET_TYPES
from opir_core.simulation.run import Run

SENSORS = ("DSP", "SBIRS-GEO", "NEXTGEN-GEO")
KINDS = ("fire", "flare", "glint")
DURATION_S = 256.0
#: From here on every sensor has had the scans that its confirmation counts, s.
WARM_UP_S = 60.0
RADIUS_KM = 6371.0
SLOT_KM = 42164.2
#: Standard deviations of ln of the level of plumes in all bands, in each, and of areas; what burns
#: is any of these.
BRIGHTNESS = 0.7
COLOUR = 0.11
AREA = 1.0
PROPELLANTS = ("kerosene", "methane", "solid", "storable", "hydrogen")
CODES = (*REPORTED_TYPES, "not reported")


class Population(NamedTuple):
    """A scene's plain values; of each emitter its kind (a type, or a kind of source) and the moment
    looked at.
    """

    scene: dict[str, Any]
    kind: NDArray[np.str_]
    moment_s: FloatArray


class Looks(NamedTuple):
    """Of one sensor, for each emitter: ln of the odds of a missile (-inf unreported), reported
    code, posterior.
    """

    log_odds: FloatArray
    code: NDArray[np.int64]
    probability: FloatArray


def population(launches: int, sources: int, seed: int) -> Population:
    """Return launches of each type and sources of each kind, with every sensor; all that is not
    named here is default.
    """
    rng = np.random.default_rng([seed, 17])
    targets = [launched(rng, kind, number) for kind in TARGET_TYPES for number in range(launches)]
    blocks = [sourced(rng, kind, sources) for kind in KINDS]
    scene = {
        "scene": "discrimination",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": DURATION_S,
        "seed": seed,
        "sensors": [{"model": model, "id": model, "orbital_slot_deg": 0.0} for model in SENSORS],
        "targets": targets,
        "sources": blocks,
        "atmosphere": {"model": "lowtran", "climate": "midlat_summer"},
        "background": "earth",
    }
    kind = np.array(
        [*(target["type"] for target in targets), *(k for k in KINDS for _ in range(sources))]
    )
    burn_s = np.array([boost_profile(target["profile"]).burn_time_s for target in targets])
    start_s = np.where(np.isin(kind, KINDS), WARM_UP_S, 0.0)
    end_s = np.concatenate([burn_s, np.full(len(KINDS) * sources, DURATION_S)])
    return Population(scene, kind, start_s + (end_s - start_s) * rng.random(len(kind)))


def launched(rng: np.random.Generator, kind: str, number: int) -> dict[str, Any]:
    """Return a launch of a type."""
    profiles = core_target_class(kind).profiles
    profile = profiles[rng.integers(len(profiles))]
    latitude, longitude = seen_from(np.arcsin(rng.uniform(0.03, 1.0)), 2.0 * np.pi * rng.random())
    limits = np.log([1.02 * profile.minimum_range_m, min(profile.maximum_range_m, 1.5e7) / 1.02])
    angle = float(np.exp(rng.uniform(*limits))) / 1e3 / RADIUS_KM
    aim = moved(latitude, longitude, angle, 2.0 * np.pi * rng.random())
    spread = BRIGHTNESS * rng.standard_normal() + COLOUR * rng.standard_normal(3)
    peaks = plume_table()["peak_w_sr"][profile.name]
    brightness = {
        name: float(peak * np.exp(more))
        for (name, peak), more in zip(peaks.items(), spread, strict=True)
    }
    return {
        "id": f"{kind}-{number}",
        "type": kind,
        "profile": profile.name,
        "launch": place(latitude, longitude),
        "aim": place(*aim),
        "signature": {
            "model": "plume",
            "propellant": str(rng.choice(PROPELLANTS)),
            "peak_w_sr": brightness,
        },
    }


def sourced(rng: np.random.Generator, kind: str, count: int) -> dict[str, Any]:
    """Return a block of sources of a kind."""
    rows = []
    for area in {"fire": 2000.0, "flare": 30.0, "glint": 1e6}[kind] * np.exp(
        AREA * rng.standard_normal(count)
    ):
        if kind == "glint":
            where = np.radians(2.2 + rng.uniform(-10.0, 10.0)), np.radians(rng.uniform(-10.0, 10.0))
        else:
            where = seen_from(np.arcsin(rng.uniform(0.03, 1.0)), 2.0 * np.pi * rng.random())
        row = {**place(*where), "area_m2": float(area)}
        if kind != "glint":
            row["temperature_k"] = float(
                rng.uniform(*{"fire": (800.0, 1200.0), "flare": (1600.0, 2000.0)}[kind])
            )
        rows.append(row)
    return {"id": kind, "model": f"{kind}s", "at": rows}


def seen_from(elevation: float, bearing: float) -> tuple[float, float]:
    """Return latitude and longitude, rad, of a place that has the satellite at an elevation,
    rad.
    """
    angle = float(np.arccos(RADIUS_KM * np.cos(elevation) / SLOT_KM) - elevation)
    return moved(0.0, 0.0, angle, bearing)


def moved(latitude: float, longitude: float, angle: float, heading: float) -> tuple[float, float]:
    """Return the place at an angle from another, on a sphere."""
    sine = np.sin(latitude) * np.cos(angle) + np.cos(latitude) * np.sin(angle) * np.cos(heading)
    across = np.sin(heading) * np.sin(angle) * np.cos(latitude)
    return float(np.arcsin(sine)), longitude + float(
        np.arctan2(across, np.cos(angle) - np.sin(latitude) * sine)
    )


def place(latitude: float, longitude: float) -> dict[str, float]:
    """Return a place as scenes write it."""
    return {
        "lat_deg": float(np.degrees(latitude)),
        "lon_deg": float((np.degrees(longitude) + 180.0) % 360.0 - 180.0),
    }


def simulated(people: Population) -> tuple[Any, Run]:
    """Return the classifier and the run of a population."""
    scene = opir.scene_from_mapping(people.scene)
    return opir.compile_plan(scene).classifier, opir.simulate(scene)


def looks_at(people: Population, classifier: Any, run: Run) -> dict[str, Looks]:
    """Return, by sensor id, the report on each emitter from the last scan before its moment."""
    found = run.detections
    target = run.truth.target
    age_ns = np.append(np.round(people.moment_s * 1e9).astype(np.int64), -1)[target] - found.time_ns
    log_odds = classifier.log_odds(found.type_log_probability)
    looks = {}
    for number, sensor in enumerate(run.sensors):
        is_last = (age_ns >= 0) & (age_ns < sensor.scan.period_ns)
        rows = np.flatnonzero((found.sensor == number) & is_last)
        score = np.full(len(people.kind), -np.inf)
        code = np.full(len(people.kind), len(REPORTED_TYPES))
        probability = np.full((len(people.kind), len(REPORTED_TYPES)), np.nan)
        score[target[rows]] = log_odds[rows]
        code[target[rows]] = found.reported_type[rows]
        probability[target[rows]] = found.type_probability[rows]
        looks[sensor.id] = Looks(score, code, probability)
    return looks


def is_right(looks: Looks, kind: NDArray[np.str_]) -> NDArray[np.bool_]:
    """Return which looks at launches are given their type."""
    launches = np.isin(kind, TARGET_TYPES)
    right: NDArray[np.bool_] = np.array(CODES)[looks.code[launches]] == kind[launches]
    return right
