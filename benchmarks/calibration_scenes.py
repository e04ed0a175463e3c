"""Scenes of `calibration.py`: launches and hot sources drawn at random below one geostationary
slot, with the prior of the classifier that is true of them.
"""

from typing import NamedTuple

import numpy as np

from opir_core.scene import core_target_class
from opir_core.scene.scene import TARGET_TYPES
from opir_core.scene.target_classes import OrbitInsertion

RADIUS_KM = 6371.0
PROPELLANTS = ("kerosene", "methane", "solid", "storable", "hydrogen")


class Source(NamedTuple):
    """A kind of hot source: temperatures, K, emissivity times area: median, m², and standard
    deviation of its logarithm; time for which it shines in the classifier's prior, s.
    """

    temperature_k: tuple[float, float] | None
    median_m2: float
    spread: float
    shining_s: float


#: Sources as in the classifier's prior, and those of single looks, with glints.
PRIOR_SOURCES = {
    "fire": Source((800.0, 1200.0), 1800.0, 2.07, 21_600.0),
    "flare": Source((1600.0, 2000.0), 9.0, 1.51, 86_400.0),
}
LOOK_SOURCES = {
    "fire": Source((800.0, 1200.0), 2000.0, 1.0, 21_600.0),
    "flare": Source((1600.0, 2000.0), 30.0, 1.0, 86_400.0),
    "glint": Source(None, 1e6, 1.0, 1200.0),
}

Place = tuple[float, float]


def place_seen(rng):
    """Return latitude and longitude, rad, of a random place that sees the satellite."""
    elevation = np.arcsin(rng.uniform(0.03, 1.0))
    angle = float(np.arccos(RADIUS_KM * np.cos(elevation) / 42164.2) - elevation)
    return moved((0.0, 0.0), angle, 2.0 * np.pi * rng.random())


def moved(place, angle, heading):
    """Return the place at an angle from another, on a sphere."""
    latitude, longitude = place
    level = np.cos(latitude) * np.sin(angle)
    sine = np.sin(latitude) * np.cos(angle) + level * np.cos(heading)
    east = np.arctan2(np.sin(heading) * level, np.cos(angle) - np.sin(latitude) * sine)
    return float(np.arcsin(sine)), longitude + float(east)


def degrees(place):
    """Return a place as scenes write it."""
    latitude, longitude = np.degrees(place).tolist()
    return {"lat_deg": latitude, "lon_deg": (longitude + 180.0) % 360.0 - 180.0}


def launched(rng, kind, number, launch, has_light=True):
    """Return a launch of a class: profile, range, heading and brightness drawn as the classifier
    assumes.
    """
    target_class = core_target_class(kind)
    profile = target_class.profiles[int(rng.integers(len(target_class.profiles)))]
    shortest_m = 1.02 * max(profile.minimum_range_m, 5e4)
    longest_m = min(profile.maximum_range_m, 1.5e7) / 1.02
    angle = float(np.exp(rng.uniform(*np.log([shortest_m, longest_m])))) / 1e3 / RADIUS_KM
    heading = 2.0 * np.pi * rng.random()
    target = {"id": f"{kind}-{number}", "type": kind, "launch": degrees(launch)}
    if has_light:
        # ln of the level of plumes: in all bands, and in each.
        spread = 0.7 * rng.standard_normal() + 0.11 * rng.standard_normal(3)
        peaks = target_class.plume(profile.name).peak_w_sr
        target["signature"] = {
            "model": "plume",
            "propellant": str(rng.choice(PROPELLANTS)),
            "peak_w_sr": {
                band: float(peak * np.exp(factor))
                for (band, peak), factor in zip(peaks.items(), spread, strict=True)
            },
        }
    if isinstance(target_class.after_burnout, OrbitInsertion):
        return {**target, "azimuth_deg": float(np.degrees(heading) % 360.0)}
    aim = degrees(moved(launch, angle, heading))
    has_profile = kind in TARGET_TYPES or len(target_class.profiles) > 1
    return {**target, "aim": aim, **({"profile": profile.name} if has_profile else {})}


def launches(rng, kinds, count):
    """Return so many launches of each class, from places that see the satellite."""
    return [
        launched(rng, kind, number, place_seen(rng)) for kind in kinds for number in range(count)
    ]


def source_blocks(rng, kinds, count):
    """Return a block of so many sources of each kind; glints are near the point below the Sun."""
    blocks = []
    for kind, source in kinds.items():
        rows = []
        for _ in range(count):
            area_m2 = float(source.median_m2 * np.exp(source.spread * rng.standard_normal()))
            if source.temperature_k is None:
                place = np.radians([2.2 + rng.uniform(-10.0, 10.0), rng.uniform(-10.0, 10.0)])
                rows.append({**degrees(tuple(place)), "area_m2": area_m2})
            else:
                temperature_k = float(rng.uniform(*source.temperature_k))
                hot = {"area_m2": area_m2, "temperature_k": temperature_k}
                rows.append({**degrees(place_seen(rng)), **hot})
        blocks.append({"id": kind, "model": f"{kind}s", "at": rows})
    return blocks


def prior(
    kinds,
    count,
    sources,
    source_count,
    time_s,
):
    """Return the settings of the classifier that are true of so many launches and sources in a
    time.
    """
    return {
        "model": "spectral",
        "launches_per_day": 86_400.0 / time_s * count * len(kinds),
        "prior": dict.fromkeys(kinds, 1.0 / len(kinds)),
        "sources_in_view": {
            kind: source_count * source.shining_s / time_s for kind, source in sources.items()
        },
    }


def slot_scene(sensors, duration_s, seed, **settings):
    """Return a scene of sensors over the Gulf of Guinea, through air and over the Earth."""
    return {
        "scene": "calibration",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": duration_s,
        "seed": seed,
        "sensors": [
            {"id": name, "orbital_slot_deg": 0.0, **sensor} for name, sensor in sensors.items()
        ],
        "atmosphere": {"model": "lowtran", "climate": "midlat_summer"},
        "background": "earth",
        "outputs": [],
        **settings,
    }
