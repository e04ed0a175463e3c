"""Orbits of sensors in ECEF, and the orbit of an `orbit:` block: geostationary, two-body, or SGP4.

Orbits that move over the ground are evaluated from polynomials, fitted once for each span of scene
time.
"""

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from attrs import define, field, frozen

from opir_core.arrays import FloatArray, RowArray
from opir_core.constants import GEOSTATIONARY_RADIUS_M
from opir_core.errors import ModelError, PluginError, Problem, SceneError, install_command
from opir_core.flight.ephemeris import Ephemeris
from opir_core.flight.kepler import propagate_kepler
from opir_core.geometry import eci_to_ecef, eci_to_ecef_state, gmst_rad
from opir_core.geometry.vectors import FloatPair, floats
from opir_core.interfaces.file_contents import BadFileError
from opir_core.orbits.configs import (
    CircularConfig,
    KeplerConfig,
    MolniyaConfig,
    OmmFileConfig,
    OrbitConfig,
    OrbitFileConfig,
    WalkerConfig,
)
from opir_core.orbits.elements import (
    Elements,
    circular_elements,
    highly_elliptical_elements,
    mean_anomaly_rad,
    slot_elements,
    walker_pattern,
)
from opir_core.orbits.mean_elements import age_warning, omm_complaint, omm_name
from opir_core.scene.input_file import file_bytes, text_of


@frozen
class TwoBodyMotion:
    """A Kepler orbit over the uniformly rotating Earth (`EARTH_ROTATION_RAD_S`)."""

    elements: Elements

    def state_eci(self, time_s: FloatArray) -> FloatPair:
        """Return positions, m, and velocities, m/s, (n, 3) in ECI at scene times (n,)."""
        position, velocity = (np.array(vector) for vector in self.elements.perigee_state_eci())
        return propagate_kepler(
            position, velocity, np.asarray(time_s) - self.elements.perigee_time_s
        )

    def position_ecef_m(self, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) in ECEF at scene times (n,)."""
        return eci_to_ecef(self.state_eci(time_s)[0], time_s)

    def state_ecef(self, time_s: FloatArray) -> FloatPair:
        """Return positions, m, and velocities relative to the rotating Earth, m/s, (n, 3) in
        ECEF.
        """
        return eci_to_ecef_state(*self.state_eci(time_s), time_s)


@frozen
class GeostationaryOrbit:
    """An ideal geostationary slot: no inclination, no eccentricity, no drift, hence one point in
    ECEF.
    """

    #: East longitude of the slot.
    slot_deg: float
    is_stationary: bool = field(default=True, init=False)

    def position_ecef_m(self, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) at scene times (n,): the same for all, as a read-only view of one
        row.
        """
        slot_rad = math.radians(self.slot_deg)
        position = (
            GEOSTATIONARY_RADIUS_M * math.cos(slot_rad),
            GEOSTATIONARY_RADIUS_M * math.sin(slot_rad),
            0.0,
        )
        return np.broadcast_to(np.array(position), (len(time_s), 3))


#: Length of a span, s. A power of two, so that dividing by it is exact and every time has one span.
SPAN_S = 2048.0

#: Spans in the cache; the oldest is dropped first, and refitted to the same bits.
KEPT_SPANS = 64

#: Initial segments of a span: enough for circular orbits above 300 km; fitting 16 takes as long as
#: fitting one.
_SEGMENTS = 16


#: Times this far from the scene epoch (777 days) or farther have no position: numbers of spans have
#: 16 bits.
FARTHEST_S = 2.0**15 * SPAN_S


class EarthFixedMotion(Protocol):
    """The motion of a satellite in ECEF, element by element."""

    def position_ecef_m(self, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) at scene times (n,)."""

    def state_ecef(self, time_s: FloatArray) -> FloatPair:
        """Return positions, m, and velocities relative to the rotating Earth, m/s, (n, 3) at scene
        times (n,).
        """


@define(eq=False)
class MovingOrbit:
    """The orbit of a satellite that moves in ECEF, to `tolerance_m`.

    Spans begin at whole multiples of `SPAN_S` of scene time: a position depends on its own time
    alone. In a span without a fit to the tolerance (SGP4 jumps where its theory changes, and ends
    where a satellite decays) the motion itself is evaluated at each time.
    """

    motion: EarthFixedMotion
    tolerance_m: float = 1e-3
    #: Warnings about the elements.
    warnings: tuple[str, ...] = ()
    is_stationary: bool = field(default=False, init=False)
    _spans: dict[int, Ephemeris | None] = field(factory=dict, init=False, repr=False)

    def position_ecef_m(self, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) at scene times (n,); nan at times that are not finite, or
        `FARTHEST_S` from 0.
        """
        time = floats(time_s)
        span = np.floor(time / SPAN_S)
        if len(span) and abs(time[0]) < FARTHEST_S and (span == span[0]).all():
            return self._position_m(int(span[0]), time)
        position = np.full((len(time), 3), np.nan)
        for number, rows in _rows_by_number(span, np.flatnonzero(np.abs(time) < FARTHEST_S)):
            position[rows] = self._position_m(number, time[rows])
        return position

    def _position_m(self, number: int, time_s: FloatArray) -> FloatArray:
        """Return positions at times that are all in one span."""
        if number not in self._spans:
            if len(self._spans) >= KEPT_SPANS:
                del self._spans[next(iter(self._spans))]
            self._spans[number] = self._fitted(number)
        ephemeris = self._spans[number]
        return (
            self.motion.position_ecef_m(time_s)
            if ephemeris is None
            else ephemeris.position_m(0, time_s)
        )

    def _fitted(self, number: int) -> Ephemeris | None:
        """Return the polynomials of a span, or None where none meet the tolerance."""
        start_s = number * SPAN_S
        cuts_s = start_s + np.arange(1, _SEGMENTS)[None, :] * (SPAN_S / _SEGMENTS)
        samples = 0

        def state(_target: RowArray, time_s: FloatArray) -> FloatPair:
            nonlocal samples
            samples += len(time_s)
            # The most samples of a motion for one span. Smooth ones need 150 to 1 000.
            if samples > 8192:
                raise ModelError("the motion is too rough")
            return self.motion.state_ecef(time_s)

        try:
            return Ephemeris.build(state, start_s, start_s + SPAN_S, cuts_s, self.tolerance_m)
        except ModelError:
            return None


def _rows_by_number(numbers: FloatArray, rows: RowArray) -> Iterator[tuple[int, RowArray]]:
    """Yield each number of the rows, with its rows in order."""
    codes = numbers[rows].astype(np.int16)
    order = np.argsort(codes, kind="stable")
    edges = np.flatnonzero(np.diff(codes[order])) + 1
    for group in np.split(rows[order], edges) if len(rows) else ():
        yield int(numbers[group[0]]), group


#: How an OMM may be named in a file of several.
_OMM_NAMES = ("OBJECT_NAME", "OBJECT_ID", "NORAD_CAT_ID")


def orbit_of(
    config: OrbitConfig, epoch_us: int, readers: Callable[[], Sequence[Any]] = tuple
) -> "GeostationaryOrbit | MovingOrbit":
    """Return the orbit of a configuration, for scenes that start at an epoch, in microseconds of
    UTC since 1970.

    `readers` returns the readers of files. Raises `SceneError`, with paths in the sensor's block,
    for a file that cannot be read and for a satellite that SGP4 cannot follow to the scene epoch,
    and `PluginError` where the package sgp4 is needed and not installed.
    """
    slot = config.slot
    if slot is not None and slot.inclination_deg == 0.0 and slot.eccentricity == 0.0:
        return GeostationaryOrbit(slot.lon_deg)
    if config.file is not None:
        return _orbit_of_file(config.file, epoch_us, readers())
    elements = elements_of(config, epoch_us)
    return (
        _sgp4_orbit(config, epoch_us) if elements is None else MovingOrbit(TwoBodyMotion(elements))
    )


def _orbit_of_file(config: OrbitFileConfig, epoch_us: int, readers: Sequence[Any]) -> MovingOrbit:
    makers = [reader.orbit for reader in readers if reader.orbit is not None]
    if not makers:
        remedy = install_command("opir-readers")
        raise PluginError(f"orbit.file: no installed plugin reads orbits from files; {remedy}")
    try:
        orbit: MovingOrbit = makers[0](config, epoch_us, readers)
    except BadFileError as error:
        raise SceneError(
            [Problem("orbit.file.path", f"{config.path}: {error}".replace(": : ", ": "))]
        ) from error
    return orbit


def _sgp4_orbit(config: OrbitConfig, epoch_us: int) -> MovingOrbit:
    from opir_core.orbits.sgp4_motion import (
        Sgp4Motion,
        satellite_of_omm,
        satellite_of_tle,
    )  # of such orbits alone

    kind = "tle" if config.tle is not None else "omm" if config.omm_file is None else "omm_file"
    if config.tle is not None:
        satellite = satellite_of_tle(config.tle)
        name = f"object {config.tle[0][2:7].strip()}"
    else:
        omm = config.omm if config.omm_file is None else omm_of_file(config.omm_file)
        assert omm is not None  # an OrbitConfig holds exactly one kind of orbit
        satellite = satellite_of_omm(omm)
        name = omm_name(omm)
    motion = Sgp4Motion(satellite, epoch_us, name)
    try:
        motion.position_teme_m(np.zeros(1))
    except ModelError as error:
        raise SceneError([Problem(f"orbit.{kind}", str(error))]) from error
    warning = age_warning(name, motion.age_days)
    return MovingOrbit(motion, warnings=() if warning is None else (warning,))


def elements_of(config: OrbitConfig, epoch_us: int) -> Elements | None:
    """Return the Kepler elements of a configuration at an epoch; None for one that SGP4 follows."""
    if config.slot is not None:
        return slot_elements(
            math.radians(config.slot.lon_deg),
            inclination_rad=math.radians(config.slot.inclination_deg),
            eccentricity=config.slot.eccentricity,
            argument_of_perigee_rad=math.radians(config.slot.arg_perigee_deg),
            mean_argument_of_latitude_rad=math.radians(config.slot.mean_arg_latitude_deg),
        )
    if config.kepler is not None:
        return _kepler(config.kepler, epoch_us)
    if config.circular is not None:
        return circular_elements(
            config.circular.altitude_km * 1e3,
            math.radians(config.circular.inclination_deg),
            _node_longitude_rad(config.circular, epoch_us),
            math.radians(config.circular.arg_latitude_deg),
        )
    if config.walker is not None:
        return _walker(config.walker, epoch_us)
    elliptical = config.molniya or config.tundra
    return None if elliptical is None else _highly_elliptical(elliptical)


def _kepler(config: KeplerConfig, epoch_us: int) -> Elements:
    if config.mean_anomaly_deg is not None:
        anomaly_rad = math.radians(config.mean_anomaly_deg)
    else:
        anomaly_rad = mean_anomaly_rad(
            math.radians(config.true_anomaly_deg or 0.0), config.eccentricity
        )
    return Elements(
        semi_major_axis_m=config.semi_major_axis_km * 1e3,
        eccentricity=config.eccentricity,
        inclination_rad=math.radians(config.inclination_deg),
        node_longitude_rad=_node_longitude_rad(config, epoch_us),
        argument_of_perigee_rad=math.radians(config.arg_perigee_deg),
        mean_anomaly_rad=anomaly_rad,
    )


def _walker(config: WalkerConfig, epoch_us: int) -> Elements:
    pattern = walker_pattern(
        config.total,
        config.planes,
        config.phasing,
        config.altitude_km * 1e3,
        math.radians(config.inclination_deg),
        star=config.kind == "star",
        first_node_longitude_rad=_node_longitude_rad(config, epoch_us),
        first_argument_of_latitude_rad=math.radians(config.arg_latitude_deg),
    )
    return pattern[config.satellite - 1]


def _highly_elliptical(config: MolniyaConfig) -> Elements:
    return highly_elliptical_elements(
        config.turns_a_day,
        config.eccentricity,
        math.radians(config.apogee_lon_deg),
        config.apogee_time_s,
        inclination_rad=math.radians(config.inclination_deg),
        argument_of_perigee_rad=math.radians(config.arg_perigee_deg),
    )


def _node_longitude_rad(
    config: KeplerConfig | CircularConfig | WalkerConfig, epoch_us: int
) -> float:
    """Return the east longitude of the ascending node at the scene epoch."""
    if config.lon_asc_node_deg is not None:
        return math.radians(config.lon_asc_node_deg)
    return math.radians(config.raan_deg or 0.0) - float(gmst_rad(np.datetime64(epoch_us, "us")))


def omm_of_file(config: OmmFileConfig) -> Mapping[str, Any]:
    """Return the OMM of a configuration; `SceneError` unless there is exactly one."""
    try:
        data = json.loads(text_of(file_bytes(config.path)))
    except OSError as error:
        raise _refused(config, f"cannot be read: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:
        raise _refused(config, f"is not JSON: {error}") from error
    messages = [
        message
        for message in (data if isinstance(data, list) else [data])
        if isinstance(message, dict)
    ]
    if config.satellite is not None:
        messages = [
            m for m in messages if config.satellite in (str(m.get(name)) for name in _OMM_NAMES)
        ]
    if len(messages) != 1:
        satellite = "" if config.satellite is None else f" of {config.satellite}"
        hint = "; say which with satellite" if messages and not satellite else ""
        raise _refused(
            config, f"holds {len(messages) or 'no'} OMM{satellite}; exactly one is needed{hint}"
        )
    if complaint := omm_complaint(messages[0]):
        raise _refused(config, complaint)
    return messages[0]


def _refused(config: OmmFileConfig, message: str) -> SceneError:
    return SceneError([Problem("orbit.omm_file.path", f"{config.path}: {message}")])
