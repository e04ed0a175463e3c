"""The states of a table against gravity: which reading of them falls freely.

After burnout and in orbit, the acceleration of a path along inertial axes is gravity's. It is computed from positions
alone, of the table as given and under each usual slip of axes and units. Where a good share of the states falls freely
as given, the table is right. Where that happens only under a slip, the slip is what was made. A boost, a glide or a
flight in air falls freely under no reading: it shows nothing.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S, GEOSTATIONARY_RADIUS_M
from opir_core.geometry import dot, ecef_to_geodetic, geodetic_to_ecef
from opir_core.plugin import StateTable
from opir_readers.celestial_frames import turned
from opir_readers.frames import axes_at, lengths
from opir_readers.interpolation import rows_apart, runs
from opir_readers.states import LEAST_RADIUS_M, MOST_RADIUS_M

#: The largest acceleration beyond central gravity of a free fall: this share of gravity, and this, m/s². The oblate
#: Earth takes 0.3 % of gravity, air above `AIRLESS_M` less than 0.02 m/s² of a dense body. A slip of axes alone leaves
#: 2 ω v: 0.3 m/s² at 2 km/s.
EXCESS_SHARE = 0.01
EXCESS_M_S2 = 0.02

#: Air slows bodies below this height, m.
AIRLESS_M = 90_000.0

#: Accelerations are taken over steps of this, s, or a twelfth of the table: over 30 s, errors of 5 m leave 0.014 m/s².
STEP_S = 30.0
PARTS = 12

#: The most states that are looked at: slips show in all.
MOST_STATES = 5000

#: A reading falls freely if these states and this share of them do; the table as given must then have less than
#: `DOUBTFUL_SHARE` of that.
MIN_STATES = 5
MIN_SHARE = 0.2
DOUBTFUL_SHARE = 0.25

#: States whose median distance from the Earth's centre is within this share of the geosynchronous
#: radius show no slip of times: there, what stands over one place falls freely at any scale of
#: time, and a longer scale hides noise.
GEOSYNCHRONOUS_SHARE = 0.05

#: A flight from below this height, m, to above it begins at rest on its pad: its velocity over the
#: ground is within this, m/s, of 0 or, along other axes, of the ground's own.
PAD_HEIGHT_M = 5000.0
PAD_SPEED_M_S = 15.0


@frozen
class Reading:
    """Times (n,), s, and positions (n, 3), m, as one slip would have them, along axes that turn `turns` times as fast
    as the Earth.

    `quantities` are the columns of the right reading by those of the wrong one; `way` mends other files.
    """

    slip: str
    time_s: FloatArray
    position_m: FloatArray
    turns: float = 1.0
    quantities: tuple[tuple[str, str], ...] = ()
    way: str = ""


@frozen
class Fall:
    """How many states of a reading fall freely, their share, and the median acceleration beyond gravity, m/s²."""

    states: int
    share: float
    excess_m_s2: float

    @property
    def is_free(self) -> bool:
        """Return whether enough states fall freely."""
        return self.states >= MIN_STATES and self.share >= MIN_SHARE


@frozen
class Misreading:
    """A slip that explains a table; `evidence` says by which figures."""

    slip: str
    evidence: str
    remedy: str


def misreading_of(table: StateTable) -> Misreading | None:
    """Return the slip under which alone a table falls freely or begins at rest, None for no slip."""
    given, *slips = _readings_of_table(table)
    fall = fall_of(given)
    if not fall.is_free:
        falls = [fall_of(slip) for slip in slips]
        shares = [other.share if other.is_free else 0.0 for other in falls]
        place = int(np.argmax(shares))
        if fall.share < DOUBTFUL_SHARE * shares[place]:
            return _misreading(table, slips[place], _evidence_of_fall(fall, falls[place]))
    if not _rests(given):
        for slip in slips:
            if slip.turns != 1.0 and _rests(slip):
                return _misreading(table, slip, _evidence_on_pad(given))
    return None


def _readings_of_table(table: StateTable) -> Iterator[Reading]:
    """Return the readings of the longest run of a table, of `MOST_STATES` at most."""
    rows = max(runs(table), key=len)
    rows = rows[:: len(rows) // MOST_STATES + 1]
    return readings(table.time_s[rows], table.position_m[rows])


def readings(time_s: FloatArray, position_m: FloatArray) -> Iterator[Reading]:
    """Yield the states as given, then as each usual slip of axes, heights, lengths and times would
    have them.
    """
    given = Reading("", time_s, position_m)
    yield given
    yield evolve(
        given,
        slip="along inertial axes, not Earth-fixed ones",
        turns=0.0,
        quantities=_renamed("ecef", "teme"),
        way="name their frame, TEME or EME2000",
    )
    yield evolve(
        given,
        slip="along Earth-fixed axes, not inertial ones",
        turns=2.0,
        quantities=(*_renamed("teme", "ecef"), *_renamed("eme2000", "ecef")),
        way="name their frame, ITRF",
    )
    yield from _other_heights(given)
    yield from _other_angles(given)
    yield from _other_units(given)


def _other_units(given: Reading) -> Iterator[Reading]:
    """Yield states with positions and times in other units."""
    frames = ("ecef", "teme", "eme2000")
    feet = tuple((f"{axis}_{frame}", f"{axis}_{frame}_ft") for frame in frames for axis in "xyz")
    place_m = 0.3048 * given.position_m
    yield evolve(given, slip="with positions in ft", position_m=place_m, quantities=feet)
    if _is_geosynchronous(given.position_m):
        return
    for unit, seconds in (("ms", 1e-3), ("min", 60.0), ("h", 3600.0)):
        names = (("time", f"time_{unit}"),)
        slip = f"with times in {unit}"
        yield evolve(given, slip=slip, time_s=seconds * given.time_s, quantities=names)


def _is_geosynchronous(position_m: FloatArray) -> bool:
    """Return whether half of the states are as far from the Earth's centre as geosynchronous
    satellites.
    """
    radius_m = float(np.median(lengths(position_m)))
    return abs(radius_m / GEOSTATIONARY_RADIUS_M - 1.0) < GEOSYNCHRONOUS_SHARE


def _other_heights(given: Reading) -> Iterator[Reading]:
    """Yield states with heights in other units, and from the Earth's centre."""
    where = ecef_to_geodetic(given.position_m)
    for unit, factor in (("km", 1e3), ("ft", 0.3048)):
        high_m = geodetic_to_ecef(where.latitude_rad, where.longitude_rad, factor * where.height_m)
        quantities = (("height", f"height_{unit}"), ("altitude", f"altitude_{unit}"))
        yield Reading(f"with heights in {unit}", given.time_s, high_m, 1.0, quantities)
    ground_m = geodetic_to_ecef(where.latitude_rad, where.longitude_rad, 0.0 * where.height_m)
    outward = ground_m / lengths(ground_m)[:, None]
    yield Reading(
        "with distances from the Earth's centre as heights",
        given.time_s,
        outward * where.height_m[:, None],
        way="subtract the Earth's radius from them",
    )


#: Columns of latitude and longitude that are exchanged, and in rad.
_EXCHANGED = (("lat", "lon"), ("lon", "lat"))
_IN_RADIANS = (("lat", "lat_rad"), ("lon", "lon_rad"))


def _other_angles(given: Reading) -> Iterator[Reading]:
    """Yield states with latitudes and longitudes in other units, exchanged, or counted to the
    west, and with two axes exchanged.
    """
    where = ecef_to_geodetic(given.position_m)
    latitude = where.latitude_rad
    longitude = where.longitude_rad

    def reading(slip: str, lat_rad: FloatArray, lon_rad: FloatArray, **described: Any) -> Reading:
        place_m = geodetic_to_ecef(lat_rad, lon_rad, where.height_m)
        return Reading(f"with longitudes {slip}", given.time_s, place_m, **described)

    yield reading("counted to the west", latitude, -longitude, way="change the sign of longitudes")
    if np.abs(longitude).max() <= 0.5 * np.pi:
        yield reading("exchanged with latitudes", longitude, latitude, quantities=_EXCHANGED)
    if np.degrees(np.abs(latitude)).max() <= 0.5 * np.pi:
        degrees = np.degrees(latitude), np.degrees(longitude)
        yield reading("in rad", *degrees, quantities=_IN_RADIANS)
    yield evolve(
        given,
        slip="with x and y exchanged",
        position_m=given.position_m[:, [1, 0, 2]],
        quantities=(("x_ecef", "y_ecef_m"), ("y_ecef", "x_ecef_m")),
        way="exchange the two",
    )


def _renamed(frame: str, right: str) -> tuple[tuple[str, str], ...]:
    """Return the columns along the axes of one frame, and those that name the right frame."""
    places = [(f"{axis}_{frame}", f"{axis}_{right}_m") for axis in "xyz"]
    rates = [(f"v{axis}_{frame}", f"v{axis}_{right}_m_s") for axis in "xyz"]
    return (*places, *rates)


def fall_of(reading: Reading) -> Fall:
    """Return how a reading falls."""
    duration_s = float(reading.time_s[-1] - reading.time_s[0])
    rows = rows_apart(reading.time_s, min(STEP_S, duration_s / PARTS))
    radius_m = lengths(reading.position_m)
    if len(rows) < 3 or radius_m.min() < LEAST_RADIUS_M or radius_m.max() > MOST_RADIUS_M:
        return Fall(0, 0.0, float("nan"))
    time_s = reading.time_s[rows]
    turned_rad = reading.turns * EARTH_ROTATION_RAD_S * (time_s - time_s[0])
    position_m = turned(reading.position_m[rows], [("z", -turned_rad)])
    gravity_m_s2 = -EARTH_MU_M3_S2 * position_m / lengths(position_m)[:, None] ** 3
    excess = _excess(time_s, position_m, gravity_m_s2)
    is_airless = ecef_to_geodetic(position_m[1:-1]).height_m > AIRLESS_M
    limit = EXCESS_SHARE * lengths(gravity_m_s2[1:-1]) + EXCESS_M_S2
    falls = is_airless & (excess < limit)
    count = int(np.count_nonzero(falls))
    shown = excess[falls if count else is_airless]
    return Fall(count, count / len(falls), float(np.median(shown)) if len(shown) else float("nan"))


def _excess(time_s: FloatArray, position_m: FloatArray, gravity_m_s2: FloatArray) -> FloatArray:
    """Return accelerations beyond gravity at all states but the first and the last (n - 2,), m/s².

    The second difference of a path is the mean of its acceleration with the weights of Numerov's
    rule, here for uneven steps.
    """
    steps = np.diff(time_s)[:, None]
    before = steps[:-1]
    after = steps[1:]
    both = before + after
    acceleration = 2.0 * np.diff(np.diff(position_m, axis=0) / steps, axis=0) / both
    late = (after**2 + before * after - before**2) / (6.0 * after * both)
    early = (before**2 + before * after - after**2) / (6.0 * before * both)
    mean = early * gravity_m_s2[:-2] + late * gravity_m_s2[2:]
    return lengths(acceleration - mean - (1.0 - early - late) * gravity_m_s2[1:-1])


def _rests(reading: Reading) -> bool:
    """Return whether a flight begins at rest over the ground, on ground that moves with the Earth."""
    velocity = _first_velocity(reading)
    return velocity is not None and float(np.hypot(velocity[0], velocity[1])) < PAD_SPEED_M_S


def _first_velocity(reading: Reading) -> FloatArray | None:
    """Return the first velocity (3,) towards east, north and up, m/s.

    None where a flight does not climb from the ground. Of axes that turn more or less than the
    Earth, the ground's own velocity is subtracted.
    """
    place_m = reading.position_m[:1]
    height_m = ecef_to_geodetic(reading.position_m).height_m
    if not height_m[0] < PAD_HEIGHT_M < height_m.max():
        return None
    rate = (reading.position_m[1] - reading.position_m[0]) / (reading.time_s[1] - reading.time_s[0])
    x, y = place_m[0, :2].tolist()
    ground = (1.0 - reading.turns) * EARTH_ROTATION_RAD_S * np.array([-y, x, 0.0])
    return dot(axes_at(place_m)[0], rate - ground)


def _misreading(table: StateTable, reading: Reading, evidence: str) -> Misreading:
    names = table.column_names
    columns = [f"{right}: {names[wrong]}" for wrong, right in reading.quantities if wrong in names]
    remedy = f"set columns: {{{', '.join(columns)}}}" if columns else reading.way or "mend the file"
    return Misreading(reading.slip, evidence, remedy)


def _evidence_of_fall(given: Fall, mended: Fall) -> str:
    as_given = f"as given {100.0 * given.share:.0f} %"
    if np.isfinite(given.excess_m_s2):
        as_given = f"{as_given}, {given.excess_m_s2:.2g} m/s² off gravity"
    return (
        f"{100.0 * mended.share:.0f} % of its states fall freely, to {mended.excess_m_s2:.1g} m/s²;"
        f" {as_given}"
    )


def _evidence_on_pad(given: Reading) -> str:
    velocity = _first_velocity(given)
    assert velocity is not None
    east = float(velocity[0])
    toward = "east" if east > 0.0 else "west"
    return (
        f"it begins at rest; as given, its first state moves {toward} with"
        f" {abs(east):.0f} m/s, as the ground does"
    )
