"""Cases of the tracking set: what is launched, who looks, and what is wrong with the looks.

A scene is a case with a seed. All random numbers of a scene come from one Philox stream of case and
seed.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml
from foreign_flights import MU, RADIUS_M, SPIN
from set_flights import drawn_vehicle, is_fit

#: Published seeds; odd ones are free to tune on.
SEEDS = (2, 4)
IGNITION_S = 10.0
GEO_ALTITUDE_M = (MU / SPIN**2) ** (1.0 / 3.0) - RADIUS_M
LEO_ALTITUDE_M = 1200e3


class Sensor(NamedTuple):
    """A sensor in a circular orbit, and what is published of it.

    Its looks come every `period_s` from `phase_s`. `sigma_rad` and `bias_sigma_rad` are as stated,
    per axis; `true_bias_sigma_rad` is the one that is drawn from.
    """

    altitude_m: float
    inclination_deg: float
    node_deg: float
    argument_deg: float
    period_s: float
    phase_s: float
    sigma_rad: float
    bias_sigma_rad: float
    true_bias_sigma_rad: float
    detection_probability: float
    clutter_per_look: float

    def position_m(self, time_s):
        """Return the ECEF positions (n, 3) at times (n,) since the epoch."""
        radius = RADIUS_M + self.altitude_m
        angle = np.radians(self.argument_deg) + np.sqrt(MU / radius**3) * time_s
        tilt = np.radians(self.inclination_deg)
        node = np.radians(self.node_deg) - SPIN * time_s
        along = np.cos(angle)
        across = np.sin(angle) * np.cos(tilt)
        x = along * np.cos(node) - across * np.sin(node)
        y = along * np.sin(node) + across * np.cos(node)
        return radius * np.stack([x, y, np.sin(angle) * np.sin(tilt)], axis=1)


class Case(NamedTuple):
    """What the scenes of a case have in common.

    `launches` maps numbers of stages to numbers of launches; these lie within `spread_km` of the
    middle; those of a salvo are of one vehicle. `orbits` has one letter a sensor, G or L. Of the
    looks a share `wide_share` has `WIDE` times the stated noise.
    """

    question: str
    launches: Mapping[int, int]
    orbits: str = "GG"
    has_gaps: bool = False
    spread_km: float = 300.0
    is_salvo: bool = False
    interval_s: float = 0.0
    period_s: float = 1.0
    sigma_urad: float = 20.0
    bias_urad: float = 0.0
    is_bias_stated: bool = True
    clutter_per_look: float = 0.0
    wide_share: float = 0.0
    detection_probability: float = 0.95


#: How much wider the noise of looks is whose stated noise is wrong.
WIDE = 3.0
#: Clutter falls within this distance from the middle of the launches, as seen by a sensor.
CLUTTER_KM = 200.0

CASES: Mapping[str, Case] = {
    name: Case(**fields)
    for name, fields in yaml.safe_load(
        Path(__file__).with_name("cases.yaml").read_text(encoding="utf-8")
    ).items()
}


class Launch(NamedTuple):
    """A launch: its stages, and the parameters of its flight (see `set_flights`)."""

    stages: int
    has_gaps: bool
    row: np.ndarray


class SetScene(NamedTuple):
    """A scene of the set: sensors, launches, the middle of the launches (rad), and the stream of
    its looks.
    """

    name: str
    case: Case
    sensors: tuple[Sensor, ...]
    launches: tuple[Launch, ...]
    middle: tuple[float, float]
    rng: np.random.Generator


def scene_of(name, seed):
    """Return the scene of a case with a seed."""
    case = CASES[name]
    rng = np.random.Generator(np.random.Philox(key=[list(CASES).index(name) + 1, seed]))
    middle = float(np.arcsin(rng.uniform(-0.8, 0.8))), float(rng.uniform(-np.pi, np.pi))
    sensors = tuple(
        _sensor(case, kind, number, middle, rng) for number, kind in enumerate(case.orbits)
    )
    return SetScene(f"{name}-{seed}", case, sensors, _launches(case, middle, rng), middle, rng)


def _launches(case, middle, rng):
    """Return the launches of a scene: at random places, in a salvo of one vehicle at much the same
    time.
    """
    launches = []
    azimuth = rng.uniform(0.0, 2.0 * np.pi)
    for stages, count in case.launches.items():
        vehicle = _vehicle(stages, case.has_gaps, middle, rng)
        for _ in range(count):
            place = _place(middle, case.spread_km, rng)
            if not case.is_salvo:
                vehicle = _vehicle(stages, case.has_gaps, place, rng)
                azimuth = rng.uniform(0.0, 2.0 * np.pi)
            delay_s = rng.uniform(0.0, max(case.interval_s, 5.0))
            row = vehicle.copy()
            row[:4] = (
                *place,
                azimuth + (rng.uniform(-0.1, 0.1) if case.is_salvo else 0.0),
                IGNITION_S + delay_s,
            )
            launches.append(Launch(stages, case.has_gaps, np.round(row, 9)))
    return tuple(launches)


def _vehicle(stages, has_gaps, place, rng):
    """Return the parameters of a drawn vehicle that flies from a place, whichever way."""
    while True:
        row = drawn_vehicle(stages, has_gaps, rng)
        row[:2] = place
        if is_fit(row, stages):
            return row


def _place(middle, spread_km, rng):
    """Return a random point within a distance from the middle, on a sphere."""
    distance = 1e3 * spread_km * np.sqrt(rng.uniform()) / 6371e3
    turn = rng.uniform(0.0, 2.0 * np.pi)
    latitude = middle[0] + distance * np.cos(turn)
    return float(latitude), float(middle[1] + distance * np.sin(turn) / np.cos(middle[0]))


def _sensor(case, kind, number, middle, rng):
    """Return a sensor that sees the middle: over the equator on alternate sides of it, or passing
    it in low orbit.
    """
    phase_s = float(np.round(rng.uniform(0.0, case.period_s), 3))
    side = (-1.0) ** number * rng.uniform(0.35, 0.75) * (number < 2)
    if kind == "G":
        orbit = GEO_ALTITUDE_M, 0.0, float(np.round(np.degrees(middle[1] + side) % 360.0, 6)), 0.0
    else:
        orbit = _passing_orbit(middle, number, rng)
    stated = case.bias_urad if case.is_bias_stated else 0.0
    return Sensor(
        *orbit,
        case.period_s,
        phase_s,
        1e-6 * case.sigma_urad,
        1e-6 * stated,
        1e-6 * case.bias_urad,
        case.detection_probability,
        case.clutter_per_look,
    )


def _passing_orbit(middle, number, rng):
    """Return a low orbit's altitude, inclination, node and argument: near the middle 100 s after
    the epoch.
    """
    distance = rng.uniform(0.1, 0.2)
    bearing = rng.uniform(0.0, 0.6) + 2.1 * number
    latitude = middle[0] + distance * np.cos(bearing)
    longitude = middle[1] + distance * np.sin(bearing) / np.cos(middle[0]) + SPIN * 100.0
    heading = rng.uniform(0.0, 2.0 * np.pi)
    flat = np.cos(latitude)
    place = np.array([flat * np.cos(longitude), flat * np.sin(longitude), np.sin(latitude)])
    east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    along = np.sin(heading) * east + np.cos(heading) * np.cross(place, east)
    normal = np.cross(place, along)
    tilt = np.arccos(normal[2])
    node = np.arctan2(normal[0], -normal[1])
    ascending = np.array([np.cos(node), np.sin(node), 0.0])
    argument = np.arctan2(np.cross(normal, ascending) @ place, ascending @ place)
    argument -= np.sqrt(MU / (RADIUS_M + LEO_ALTITUDE_M) ** 3) * 100.0
    degrees = (float(np.round(np.degrees(angle) % 360.0, 6)) for angle in (tilt, node, argument))
    return LEO_ALTITUDE_M, *degrees
