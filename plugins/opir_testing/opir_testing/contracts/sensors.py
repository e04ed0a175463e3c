"""Conformance tests of sensor models and constellations."""

import json
import math
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from attrs import fields_dict

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M
from opir_core.geometry import ecef_to_geodetic
from opir_core.plugin import (
    TARGET_TYPES,
    Constellation,
    ScanningSensorConfig,
    Sensor,
    SensorContext,
    SensorModel,
    TargetClass,
)
from opir_core.scene import MAXIMUM_BANDS, info_of
from opir_core.sensors import confusion_complaint, is_probability
from opir_testing.bench import (
    NEIGHBOUR_SENSOR,
    SENSORS,
    BenchRun,
    LookTable,
    bench_scene,
    launch,
    planned,
)
from opir_testing.contracts.contract import (
    ConformanceError,
    count_excess,
    require,
    require_independent_rows,
    require_same_copy,
    require_same_events,
    uniformity_excess,
)
from opir_testing.contracts.scenes import SceneContract

#: The id of the sensor under test in the test scene.
SUBJECT = "SUBJECT"

_EPOCH_US = 1_775_044_800_000_000
_SPEED_LIMIT_M_S = 1.2e4
#: The limit for which the core's visibility is exact (`opir_core.planning.visibility`).
_ACCELERATION_LIMIT_M_S2 = 100.0
_LEAST_RADIUS_M = 6.4e6
#: Launches below the sensor, and the time between two, s: a day, in steps that no usual orbit
#: repeats.
_LAUNCHES = 23
_LAUNCH_STEP_S = 3757.0
#: The least share of the half angle of the Earth's disk that the default cone covers.
_LEAST_SHARE = 0.8
_DAY_S = np.linspace(0.0, 86_400.0, 289)


class SensorContract(SceneContract):
    """Conformance tests of a sensor model. A sensor that needs a slot or an orbit gets the slot 100
    degrees west.
    """

    kind = SensorModel

    @classmethod
    def block(cls) -> Mapping[str, Any]:
        """Return the settings, with a slot if the sensor needs one."""
        orbits = {"orbital_slot_deg", "orbit"} & cls.settings.keys()
        setting_fields = fields_dict(cls.component().config)
        needs_slot = (
            "orbital_slot_deg" in setting_fields
            and not orbits
            and not ("orbit" in setting_fields and setting_fields["orbit"].default)
        )
        return {**cls.settings, **({"orbital_slot_deg": -100.0} if needs_slot else {})}

    @classmethod
    def scene(cls, **changes: Any) -> dict[str, Any]:
        """Return the test scene with the sensor first; every look detects."""
        subject = {"model": cls.name, "id": SUBJECT, **cls.block()}
        certain = {"detection": "always", "classification": "none"}
        return bench_scene(**{"sensors": [subject, *SENSORS[1:]], **certain, **changes})

    @classmethod
    @cache
    def sensor(cls) -> Sensor:
        """Return the built sensor."""
        return cls.built(Sensor, cls.config(), SensorContext(id=SUBJECT, epoch_us=_EPOCH_US))

    @classmethod
    def part(cls) -> Any:
        """Return the built sensor."""
        return cls.sensor()

    def test_fields_are_valid(self) -> None:
        """Bands, angles, errors and probabilities are valid."""
        sensor: Any = self.sensor()
        classes = set(self.host().names(TargetClass))
        names = [band.name for band in sensor.bands]
        half = sensor.field_of_regard_half_angle_rad
        least = sensor.minimum_elevation_rad
        valid = {
            "id: that of the context": sensor.id == SUBJECT,
            "type: not empty": isinstance(sensor.type, str) and bool(sensor.type.strip()),
            f"bands: 1 to {MAXIMUM_BANDS}, each name once": 1
            <= len(set(names))
            == len(names)
            <= MAXIMUM_BANDS,
            "bands: 0 < lower_um < upper_um": all(
                0.0 < band.lower_um < band.upper_um for band in sensor.bands
            ),
            "orbital_slot_deg: in [-180, 360] or None": sensor.orbital_slot_deg is None
            or -180.0 <= sensor.orbital_slot_deg <= 360.0,
            "field_of_regard_half_angle_rad: in (0, pi]": 0.0 < half <= math.pi,
            "minimum_elevation_rad: in [-pi/2, pi/2]": abs(least) <= math.pi / 2.0,
            "solar_exclusion_rad: in [0, pi]": 0.0 <= sensor.solar_exclusion_rad <= math.pi,
            "line_of_sight_sigma_rad: in [0, 0.1]": 0.0 <= sensor.line_of_sight_sigma_rad <= 0.1,
            "detection_probability: of target classes, in [0, 1]": sensor.detection_probability.keys()
            <= classes
            and all(map(is_probability, sensor.detection_probability.values())),
            "confusion: rows of target classes that sum to 1": confusion_complaint(sensor.confusion)
            is None
            and sensor.confusion.keys() <= classes
            and all(row.keys() <= {*classes, "UNKNOWN"} for row in sensor.confusion.values()),
        }
        for condition, holds in valid.items():
            require(
                holds,
                f"not valid: {condition}",
                "Validate it in the configuration class, or change its default.",
            )

    def test_settings_are_plain_values(self) -> None:
        """The settings in the manifest are plain values."""
        try:
            json.dumps(dict(self.sensor().settings), allow_nan=False)
        except (TypeError, ValueError) as error:
            raise ConformanceError(
                f"settings are not plain values: {error}",
                "Give Sensor settings=attrs.asdict(config).",
            ) from error

    def test_a_launch_below_it_is_seen(self) -> None:
        """Within a day the sensor looks at some launch that is below it at ignition."""
        places = self.places(_LAUNCH_STEP_S * np.arange(_LAUNCHES, dtype=np.float64))
        targets = [
            launch(f"BELOW-{number}", "ICBM", place, _aim(place), number * _LAUNCH_STEP_S)
            for number, place in enumerate(places)
        ]
        scene = self.scene(targets=targets, duration_s=_LAUNCHES * _LAUNCH_STEP_S)
        scene["sensors"] = scene["sensors"][:1]
        looks = LookTable.of(planned(scene, self.host()))
        require(
            len(looks.row),
            f"it has no look at any of {_LAUNCHES} launches below it in a day",
            "Widen field_of_regard_half_angle_deg (60 and more for a low orbit), lower"
            " minimum_elevation_deg, or scan more often.",
        )

    def test_the_default_field_of_regard_fits_the_orbit(self) -> None:
        """The default cone, which follows the orbit, covers most of the Earth's disk."""
        name = "field_of_regard_half_angle_deg"
        setting, default = (
            fields_dict(config).get(name)
            for config in (self.component().config, ScanningSensorConfig)
        )
        if (
            setting is None
            or default is None
            or name in self.block()
            or info_of(setting) != info_of(default)
        ):
            return
        sensor = self.sensor()
        radius_m = np.sqrt(np.sum(sensor.orbit.position_ecef_m(_DAY_S) ** 2, axis=1)).max()
        cone_deg = math.degrees(sensor.field_of_regard_half_angle_rad)
        disk_deg = math.degrees(math.asin(min(EARTH_EQUATORIAL_RADIUS_M / radius_m, 1.0)))
        require(
            cone_deg >= _LEAST_SHARE * disk_deg,
            f"its field of regard is {cone_deg:g} deg by default; in this orbit the Earth's disk"
            f" has a half angle of"
            f" {disk_deg:.1f} deg or more, so that most of what is in view is not observed",
            f"Leave it to built_sensor, or set it: with_defaults({name}=cited({disk_deg:.1f},"
            f" ...)).",
        )

    def test_looks_are_whole_periods_apart(self) -> None:
        """Looks at one target are whole periods apart."""
        period_ns: Any = self.sensor().scan.period_ns
        require(
            isinstance(period_ns, int) and period_ns > 0,
            f"period_ns is {period_ns!r}",
            "Make the period a whole, positive number of nanoseconds.",
        )
        run = self.run()
        is_subject = run.detections.sensor == [sensor.id for sensor in run.plan.sensors].index(
            SUBJECT
        )
        for target in sorted(set(run.truth.target[is_subject].tolist())):
            gaps = np.diff(
                np.sort(run.detections.time_ns[is_subject & (run.truth.target == target)])
            )
            require(
                np.all((gaps > 0) & (gaps % period_ns == 0)),
                f"looks at one target come {gaps.min(initial=period_ns)} ns apart, with a period of"
                f" {period_ns} ns",
                "phase_ns(...) is one offset for all scans of a target; scan k looks at phase + k *"
                " period.",
            )

    def test_phases_lie_in_the_period(self) -> None:
        """Offsets are whole nanoseconds in [0, period) for targets anywhere, also at the nadir."""
        scan = self.sensor().scan
        position = self._here()
        for uniform in (0.0, 0.37, 1.0 - 2.0**-53):
            phase = scan.phase_ns(position, _targets_m(position), uniform)
            require(
                phase.dtype == np.int64 and bool(np.all((phase >= 0) & (phase < scan.period_ns))),
                f"phase_ns is {phase.dtype} from {phase.min()} to {phase.max()}, the period"
                f" {scan.period_ns}",
                "Return whole numbers (int64) in [0, period): floor, then remainder; 0 if the angle"
                " is undefined.",
            )

    def test_phases_are_independent(self) -> None:
        """The offset of a target does not depend on the other rows of the call."""
        scan = self.sensor().scan
        position = self._here()
        targets = _targets_m(position)
        require_independent_rows(
            "phase_ns", lambda rows: scan.phase_ns(position, targets[rows], 0.25), len(targets)
        )

    def test_orbit_is_above_the_ground_and_smooth(self) -> None:
        """Positions are finite, above the ground and continuous, with bounded speed and
        acceleration.
        """
        orbit = self.sensor().orbit
        time_s = np.linspace(0.0, 86_400.0, 24 * 60 + 1)
        position_m = orbit.position_ecef_m(time_s)
        require(
            position_m.shape == (len(time_s), 3),
            f"position_ecef_m is {position_m.shape}",
            "Return (n, 3) for (n,).",
        )
        radius_m = np.sqrt(np.sum(position_m**2, axis=1))
        require(
            np.all(radius_m > _LEAST_RADIUS_M),
            f"it is {radius_m.min():.0f} m from the Earth's centre",
            "Positions are ECEF, in metres, above the ground.",
        )
        close_s = np.arange(0.0, 600.0)
        velocity = np.diff(orbit.position_ecef_m(close_s), axis=0)
        speed = np.abs(velocity).max()
        acceleration = np.abs(np.diff(velocity, axis=0)).max()
        require(
            speed < _SPEED_LIMIT_M_S and acceleration < _ACCELERATION_LIMIT_M_S2,
            f"its speed is up to {speed:.0f} m/s, its acceleration up to {acceleration:.1f} m/s2",
            "Positions are continuous, ECEF, in metres; time is in seconds since the epoch.",
        )

    def test_a_stationary_orbit_does_not_move(self) -> None:
        """An orbit with `is_stationary` has one position."""
        orbit = self.sensor().orbit
        position_m = orbit.position_ecef_m(np.array([0.0, 1.0, 43_200.0]))
        require(
            not orbit.is_stationary or bool(np.all(position_m == position_m[0])),
            "is_stationary is True, but the position changes",
            "Set is_stationary = False: the engine computes a stationary sensor's position once.",
        )

    def test_positions_are_independent(self) -> None:
        """The position at a time does not depend on the other times of the call."""
        orbit = self.sensor().orbit
        time_s = np.linspace(0.0, 5000.0, 61)
        require_independent_rows(
            "position_ecef_m", lambda rows: orbit.position_ecef_m(time_s[rows]), len(time_s)
        )

    def test_line_of_sight_errors_follow_the_stated_sigma(self) -> None:
        """Errors of measured lines of sight are normal, with the stated standard deviation."""
        run = self.run_of(self.scene(sensors=self.scene()["sensors"][:1], seed=5))
        stated = run.detections.line_of_sight_sigma_rad
        error = _errors_rad(run)[stated > 0.0]
        # Two independent normal errors: the square over 2 sigma squared is exponential.
        excess = uniformity_excess(-np.expm1(-0.5 * (error / stated[stated > 0.0]) ** 2))
        require(
            excess <= 1.0,
            f"the distribution of {len(error)} line-of-sight errors deviates by {excess:.2f} times"
            f" the 99.9 % limit",
            "State the standard deviation of each of two axes across the line of sight, in radians.",
        )

    def test_detections_occur_at_the_stated_rate(self) -> None:
        """With detection: constant, the number of detections agrees with the stated probabilities
        (99.9 %).
        """
        probability = self.sensor().detection_probability
        if not set(TARGET_TYPES) <= probability.keys():
            return
        scene = self.scene(sensors=self.scene()["sensors"][:1])
        full_run = self.run_of(scene)
        drawn = self.run_of({**scene, "detection": "constant"})
        types = full_run.plan.targets.type_code[full_run.truth.target]
        chances = np.array([probability[name] for name in TARGET_TYPES])[types]
        excess = count_excess(len(drawn.lines), chances)
        require(
            excess <= 1.0,
            f"{len(drawn.lines)} of {len(chances)} looks detect; the expectation is"
            f" {chances.sum():.1f}",
            "The look times of a sensor must not depend on the detection model.",
        )

    def test_results_of_others_do_not_change(self) -> None:
        """The sensor does not change the events of other sensors, and another sensor does not
        change its events.
        """
        scene = self.scene()
        without = self.run_of({**scene, "sensors": scene["sensors"][1:]})
        other_lines = self.run().lines_of(
            [sensor.id for sensor in without.plan.sensors], without.plan.targets.ids
        )
        change = "Build each sensor from its own block and context; share no state."
        require_same_events(without.lines, other_lines, "with this sensor", change)
        grown = self.run_of({**scene, "sensors": [NEIGHBOUR_SENSOR, *scene["sensors"]]})
        lines = grown.lines_of([SUBJECT], grown.plan.targets.ids)
        subject_lines = self.run().lines_of([SUBJECT], grown.plan.targets.ids)
        require_same_events(subject_lines, lines, "with a neighbour", change)

    def test_a_built_sensor_pickles(self) -> None:
        """The built sensor can be pickled, and its copy returns the same positions and phases."""
        position = self._here()
        time_s = np.linspace(0.0, 600.0, 7)
        require_same_copy(self.sensor(), lambda sensor: sensor.orbit.position_ecef_m(time_s))
        require_same_copy(
            self.sensor(), lambda sensor: sensor.scan.phase_ns(position, _targets_m(position), 0.5)
        )

    def places(self, time_s: FloatArray) -> list[tuple[float, float]]:
        """Return latitude and longitude, deg, of the points below the sensor at some times (n,)."""
        below = ecef_to_geodetic(self.sensor().orbit.position_ecef_m(time_s))
        return list(
            zip(*np.degrees([below.latitude_rad, below.longitude_rad]).tolist(), strict=True)
        )

    def _here(self) -> FloatArray:
        return self.sensor().orbit.position_ecef_m(np.zeros(1))[0]


def _aim(place: tuple[float, float]) -> tuple[float, float]:
    """Return latitude and longitude, deg, of a point about 6 000 km away, towards the equator."""
    latitude, longitude = place
    return latitude - math.copysign(54.0, latitude), longitude


class ConstellationContract(SensorContract):
    """Conformance tests of a constellation: those of its sensor model with its first satellite, and
    a run of all.
    """

    @classmethod
    def constellation(cls) -> Constellation:
        """Return the constellation."""
        return cls.host().component(Constellation, cls.name)

    @classmethod
    def offered(cls) -> Any:
        """Return the constellation."""
        return cls.constellation()

    @classmethod
    def component(cls) -> Any:
        """Return the sensor model of the satellites."""
        return cls.host().component(SensorModel, cls.constellation().model)

    @classmethod
    def block(cls) -> Mapping[str, Any]:
        """Return the settings of the first satellite."""
        first_looks = {
            key: value for key, value in cls.constellation().satellites[0].items() if key != "id"
        }
        return {**first_looks, **cls.settings}

    @classmethod
    def scene(cls, **changes: Any) -> dict[str, Any]:
        """Return the test scene with the first satellite."""
        subject = {"model": cls.constellation().model, "id": SUBJECT, **cls.block()}
        return super().scene(**{"sensors": [subject, *SENSORS[1:]], **changes})

    def test_the_constellation_runs(self) -> None:
        """A scene with the constellation has all its satellites, each at its own position."""
        run = self.run_of(
            bench_scene(sensors=[{"constellation": self.name}], classification="none")
        )
        ids = [row["id"] for row in self.constellation().satellites]
        require(
            [sensor.id for sensor in run.plan.sensors] == ids,
            "a scene has other satellites",
            "Check the ids.",
        )
        positions = {
            tuple(sensor.orbit.position_ecef_m(np.zeros(1))[0].tolist())
            for sensor in run.plan.sensors
        }
        require(
            len(positions) == len(ids),
            f"{len(ids)} satellites are at {len(positions)} positions at the epoch",
            "Give each satellite a slot or an orbit of its own.",
        )


def _targets_m(position: FloatArray) -> FloatArray:
    """Return targets (n, 3): a grid over the globe, the poles, the antimeridian, the nadir and its
    antipode.
    """
    latitude, longitude = np.radians(np.mgrid[-90:91:30, -180:181:36].reshape(2, -1))
    ring = np.stack(
        [
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        ],
        axis=1,
    )
    below = position / np.sqrt(np.sum(position**2))
    return 6.45e6 * np.concatenate([ring, [below, -below]])


def _errors_rad(run: BenchRun) -> FloatArray:
    """Return the angles (n,) between measured and true lines of sight; the true one includes the
    sensor's bias.
    """
    plan = run.plan
    detections = run.detections
    offset_m = (
        plan.targets.position_ecef_m(run.truth.target, run.truth.emission_time_s)
        - detections.sensor_ecef_m
    )
    true = offset_m / np.sqrt(np.sum(offset_m**2, axis=1))[:, None]
    if plan.bias is not None:
        x, y, z = true.T
        true = np.stack(
            plan.bias.applied(x, y, z, detections.sensor, detections.sensor_ecef_m), axis=1
        )
    # From the chord between unit vectors: for small angles an arccosine would lose all digits.
    chord = np.sqrt(np.sum((detections.line_of_sight_ecef - true) ** 2, axis=1))
    return 2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0))
