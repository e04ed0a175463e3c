"""Broken sensor models."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from attrs import evolve, fields_dict, frozen

from broken_components.offers import SOUND, mutant
from opir_core.arrays import FloatArray
from opir_core.builtin.scanner import ScannerConfig
from opir_core.orbits.configs import CircularConfig, OrbitConfig
from opir_core.plugin import Band, SensorModel, scanning_sensor, with_defaults
from opir_core.sensors import AlignedScan


def sensor_mutant(name, caught_by, config=ScannerConfig):
    """Offer a sensor made of the bench's by a change to it."""

    def offered(change):
        def build(settings, context):
            return change(scanning_sensor(settings, context, type="MUTANT"))

        return mutant(SensorModel, name, caught_by, config)(build)

    return offered


@frozen
class OwnScan:
    """The bench's scan with another phase."""

    scan: Any
    change: Callable[[Any, int], Any]

    @property
    def period_ns(self):
        return int(self.scan.period_ns)

    def phase_ns(self, sensor_ecef_m, target_ecef_m, uniform):
        return self.change(
            self.scan.phase_ns(sensor_ecef_m, target_ecef_m, uniform), self.scan.period_ns
        )


def beyond(phase, period_ns):
    return phase + period_ns


def by_rank(phase, period_ns):
    return (phase + np.arange(len(phase))) % period_ns


@sensor_mutant("phase-beyond-period", "test_phases_lie_in_the_period")
def _phase_beyond(sensor):
    return evolve(sensor, scan=OwnScan(sensor.scan, beyond))


@sensor_mutant("phase-by-rank", "test_phases_are_independent")
def _phase_by_rank(sensor):
    return evolve(sensor, scan=OwnScan(sensor.scan, by_rank))


@frozen
class FractionalScan:
    """A period that is no whole number."""

    scan: Any
    period_ns: float = 5e8

    def phase_ns(self, *where):
        return self.scan.phase_ns(*where)


@sensor_mutant("period-of-fractions", "test_looks_are_whole_periods_apart")
def _period_of_fractions(sensor):
    return evolve(sensor, scan=FractionalScan(sensor.scan))


@frozen
class OwnOrbit:
    """An orbit made of another by a change to its positions."""

    orbit: Any
    change: Callable[[FloatArray, FloatArray], FloatArray]
    is_stationary: bool

    def position_ecef_m(self, time_s):
        return self.change(self.orbit.position_ecef_m(time_s), time_s)


def in_km(place, _time_s):
    return place / 1000.0


def drifting(place, time_s):
    return place + time_s[:, None]


def centred(place, time_s):
    return place + (time_s - np.sum(time_s) / max(len(time_s), 1))[:, None]


@sensor_mutant("orbit-in-km", "test_orbit_is_above_the_ground_and_smooth")
def _orbit_in_km(sensor):
    return evolve(sensor, orbit=OwnOrbit(sensor.orbit, in_km, True))


@sensor_mutant("stationary-that-drifts", "test_a_stationary_orbit_does_not_move")
def _stationary_that_drifts(sensor):
    return evolve(sensor, orbit=OwnOrbit(sensor.orbit, drifting, True))


@sensor_mutant("orbit-by-batch", "test_positions_are_independent")
def _orbit_by_batch(sensor):
    return evolve(sensor, orbit=OwnOrbit(sensor.orbit, centred, False))


@sensor_mutant("bands-upside-down", "test_fields_are_valid")
def _bands_upside_down(sensor):
    return evolve(sensor, bands=(Band("SWIR", 2.9, 2.5),))


@sensor_mutant("settings-of-arrays", "test_settings_are_plain_values")
def _settings_of_arrays(sensor):
    return evolve(sensor, settings={"edges": np.zeros(2)})


@sensor_mutant("settings-of-nan", "test_settings_are_plain_values")
def _settings_of_nan(sensor):
    return evolve(sensor, settings={"gain": np.nan})


@sensor_mutant("sensor-of-lambdas", "test_a_built_sensor_pickles")
def _sensor_of_lambdas(sensor):
    return evolve(sensor, scan=OwnScan(sensor.scan, lambda phase, period_ns: phase))


@frozen(kw_only=True)
class MuteConfig(ScannerConfig):
    """A configuration with a field that says nothing of itself."""

    gain: float = 1.0


@sensor_mutant("mute-setting", "test_every_setting_is_documented", MuteConfig)
def _mute_setting(sensor):
    return sensor


LOW_ORBIT = {
    "altitude_km": 1200.0,
    "inclination_deg": 87.0,
    "raan_deg": 10.0,
    "arg_latitude_deg": 0.0,
}


def low_orbit(settings, context):
    """Build a sensor in a low orbit, with all else as in the settings."""
    orbit = OrbitConfig(circular=CircularConfig(**LOW_ORBIT))
    return scanning_sensor(
        evolve(settings, orbital_slot_deg=None, orbit=orbit), context, type="MUTANT"
    )


def cone_of_geo(settings, context):
    """Build a sensor in a low orbit with the cone of a geostationary one."""
    return evolve(low_orbit(settings, context), field_of_regard_half_angle_rad=math.radians(10.0))


mutant(
    SensorModel, "cone-of-geo", "test_the_default_field_of_regard_fits_the_orbit", ScannerConfig
)(cone_of_geo)


GIVEN = {
    name: fields_dict(ScannerConfig)[name].default
    for name in ("bands", "scan_period_ms", "detection_probability")
}


@with_defaults(field_of_regard_half_angle_deg=60.0, **GIVEN)
class LowConfig(ScannerConfig):
    """A cone for a low orbit."""


SOUND.add((SensorModel.hook, "sound-low-orbit"))
mutant(SensorModel, "sound-low-orbit", "", LowConfig)(low_orbit)


@sensor_mutant("looks-once-a-day", "test_a_launch_below_it_is_seen")
def _looks_once_a_day(sensor):
    return evolve(sensor, scan=AlignedScan(86_400_000_000_000))


@mutant(SensorModel, "forgets-to-return", "test_build_returns_a_complete_part", ScannerConfig)
def _forgets_to_return(settings, context):
    scanning_sensor(settings, context, type="MUTANT")
