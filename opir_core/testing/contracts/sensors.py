"""The contract of sensor models and of the constellations that carry them."""

import json
import math
from collections.abc import Mapping
from functools import cache
from typing import Any, ClassVar

import numpy as np
from attrs import fields_dict

from opir_core.arrays import FloatArray
from opir_core.interfaces.contexts import SensorContext
from opir_core.interfaces.protocols import Sensor
from opir_core.plugin.components import Component, Constellation, SensorModel
from opir_core.scene.scene import MAXIMUM_BANDS, TARGET_TYPES
from opir_core.sensors.confusion_matrix import confusion_complaint, is_probability
from opir_core.testing.bench import NEIGHBOUR_SENSOR, SENSORS, BenchRun, bench_scene
from opir_core.testing.chance import excess_of_count, excess_of_distribution
from opir_core.testing.contracts.comparisons import insist_pickles, insist_rows_stand_alone, insist_same_lines
from opir_core.testing.contracts.contract import Broken, insist
from opir_core.testing.contracts.scenes import SceneContract

#: The id of the sensor under test in the bench's scene.
SUBJECT = "SUBJECT"

_EPOCH_US = 1_775_044_800_000_000
_SPEED_LIMIT_M_S = 1.2e4
#: What the core's lines of sight are certain for (`opir_core.planning.visibility`).
_ACCELERATION_LIMIT_M_S2 = 100.0
_LEAST_RADIUS_M = 6.4e6


class SensorContract(SceneContract):
    """What a sensor model promises. A sensor that needs a place gets the slot of 100 degrees west."""

    kind: ClassVar[type[Component]] = SensorModel

    @classmethod
    def block(cls) -> Mapping[str, Any]:
        """Return the settings, with a place for sensors whose place a scene says."""
        placed = {"orbital_slot_deg", "orbit"} & cls.settings.keys()
        needs_place = "orbital_slot_deg" in fields_dict(cls.component().config) and not placed
        return {**cls.settings, **({"orbital_slot_deg": -100.0} if needs_place else {})}

    @classmethod
    def scene(cls, **changes: Any) -> dict[str, Any]:
        """Return the bench's scene with the sensor first; every look detects."""
        subject = {"model": cls.name, "id": SUBJECT, **cls.block()}
        certain = {"detection": "always", "classification": "none"}
        return bench_scene(**{"sensors": [subject, *SENSORS[1:]], **certain, **changes})

    @classmethod
    @cache
    def sensor(cls) -> Sensor:
        """Return the built sensor."""
        made: Sensor = cls.component().build(cls.config(), SensorContext(id=SUBJECT, epoch_us=_EPOCH_US))
        return made

    def test_fields_are_lawful(self) -> None:
        """Bands, angles, errors and probabilities are what the engine can use."""
        sensor: Any = self.sensor()
        names = [band.name for band in sensor.bands]
        half, least = sensor.field_of_regard_half_angle_rad, sensor.minimum_elevation_rad
        lawful = {
            "id: the one of the context": sensor.id == SUBJECT,
            "type: a word": isinstance(sensor.type, str) and bool(sensor.type.strip()),
            f"bands: 1 to {MAXIMUM_BANDS}, each name once": 1 <= len(set(names)) == len(names) <= MAXIMUM_BANDS,
            "bands: 0 < lower_um < upper_um": all(0.0 < band.lower_um < band.upper_um for band in sensor.bands),
            "orbital_slot_deg: in [-180, 360] or None": sensor.orbital_slot_deg is None
            or -180.0 <= sensor.orbital_slot_deg <= 360.0,
            "field_of_regard_half_angle_rad: in (0, pi]": 0.0 < half <= math.pi,
            "minimum_elevation_rad: in [-pi/2, pi/2]": abs(least) <= math.pi / 2.0,
            "line_of_sight_sigma_rad: in [0, 0.1]": 0.0 <= sensor.line_of_sight_sigma_rad <= 0.1,
            "detection_probability: of target types, in [0, 1]": sensor.detection_probability.keys()
            <= set(TARGET_TYPES)
            and all(map(is_probability, sensor.detection_probability.values())),
            "confusion: rows that sum to 1": confusion_complaint(sensor.confusion) is None,
        }
        for promise, kept in lawful.items():
            insist(kept, f"{promise} is not so", "Check it in the configuration class, or give it another default.")

    def test_settings_are_plain_values(self) -> None:
        """The settings that the manifest records are plain values."""
        try:
            json.dumps(dict(self.sensor().settings), allow_nan=False)
        except (TypeError, ValueError) as error:
            raise Broken(
                f"settings are not plain values: {error}", "Give Sensor settings=attrs.asdict(config)."
            ) from error

    def test_look_times_increase_and_keep_the_period(self) -> None:
        """Looks at one target follow each other by exactly one period, or by a whole number where some are not seen."""
        period_ns: Any = self.sensor().scan.period_ns
        insist(
            isinstance(period_ns, int) and period_ns > 0,
            f"period_ns is {period_ns!r}",
            "Make the period a whole, positive number of nanoseconds.",
        )
        run = self.run()
        mine = run.detections.sensor == _place_of(run)
        for target in sorted(set(run.truth.target[mine].tolist())):
            gaps = np.diff(run.detections.time_ns[mine & (run.truth.target == target)])
            insist(
                bool(np.all((gaps > 0) & (gaps % period_ns == 0))),
                f"looks at one target come {gaps.min(initial=period_ns)} ns apart, with a period of {period_ns} ns",
                "phase_ns(...) is one offset for all scans of a target; scan k looks at phase + k * period.",
            )

    def test_phases_lie_in_the_period(self) -> None:
        """Offsets are whole nanoseconds in [0, period), for targets anywhere, also right below the sensor."""
        scan, here = self.sensor().scan, self._here()
        for uniform in (0.0, 0.37, 1.0 - 2.0**-53):
            phase = scan.phase_ns(here, _places_m(here), uniform)
            insist(
                phase.dtype == np.int64 and bool(np.all((phase >= 0) & (phase < scan.period_ns))),
                f"phase_ns gives {phase.dtype} from {phase.min()} to {phase.max()}, with a period of {scan.period_ns}",
                "Return whole numbers (int64) in [0, period): floor, then remainder, and 0 where there is no angle.",
            )

    def test_each_target_has_its_own_phase(self) -> None:
        """The offset of a target does not depend on which others are asked about with it."""
        scan, here = self.sensor().scan, self._here()
        places = _places_m(here)
        insist_rows_stand_alone("phase_ns", lambda rows: scan.phase_ns(here, places[rows], 0.25), len(places))

    def test_orbit_is_above_the_ground_and_smooth(self) -> None:
        """Positions are finite, above the ground, and move as a satellite does."""
        orbit, time_s = self.sensor().orbit, np.linspace(0.0, 86_400.0, 24 * 60 + 1)
        place_m = orbit.position_ecef_m(time_s)
        insist(place_m.shape == (len(time_s), 3), f"position_ecef_m gives {place_m.shape}", "Return (n, 3) for (n,).")
        radius_m = np.sqrt(np.sum(place_m**2, axis=1))
        insist(
            bool(np.all(radius_m > _LEAST_RADIUS_M)),
            f"it comes to {radius_m.min():.0f} m of the Earth's centre",
            "Positions are in metres, Earth-centred and Earth-fixed, and above the ground.",
        )
        close_s = np.arange(0.0, 600.0)
        velocity = np.diff(orbit.position_ecef_m(close_s), axis=0)
        speed, turn = np.abs(velocity).max(), np.abs(np.diff(velocity, axis=0)).max()
        insist(
            speed < _SPEED_LIMIT_M_S and turn < _ACCELERATION_LIMIT_M_S2,
            f"it moves up to {speed:.0f} m/s and turns by up to {turn:.1f} m/s in a second",
            "Positions are continuous, in ECEF, in metres; time is in seconds after the epoch.",
        )

    def test_a_stationary_orbit_stays(self) -> None:
        """An orbit that says it is stationary has one position."""
        orbit = self.sensor().orbit
        place_m = orbit.position_ecef_m(np.array([0.0, 1.0, 43_200.0]))
        insist(
            not orbit.is_stationary or bool(np.all(place_m == place_m[0])),
            "is_stationary is true, and the position changes",
            "Say is_stationary = False: the engine asks for a stationary sensor's position once.",
        )

    def test_each_moment_has_its_own_position(self) -> None:
        """The position at a time does not depend on which other times are asked for."""
        orbit, time_s = self.sensor().orbit, np.linspace(0.0, 5000.0, 61)
        insist_rows_stand_alone("position_ecef_m", lambda rows: orbit.position_ecef_m(time_s[rows]), len(time_s))

    def test_lines_of_sight_scatter_as_stated(self) -> None:
        """The errors of measured lines of sight have the stated standard deviation and are normal."""
        run = self.run_of(self.scene(sensors=self.scene()["sensors"][:1], seed=5))
        stated = run.detections.line_of_sight_sigma_rad
        error = _errors_rad(run)[stated > 0.0]
        # Two independent normal errors: the square over 2 sigma squared is exponential.
        excess = excess_of_distribution(-np.expm1(-0.5 * (error / stated[stated > 0.0]) ** 2))
        insist(
            excess <= 1.0,
            f"{len(error)} errors of lines of sight are {excess:.2f} times as far from the stated distribution as"
            " chance explains (99.9 %)",
            "State the standard deviation of each of two axes across the line of sight, in radians.",
        )

    def test_detections_come_at_the_stated_rate(self) -> None:
        """With detection: constant, looks detect as often as the stated probabilities say (99.9 %)."""
        probability = self.sensor().detection_probability
        if not set(TARGET_TYPES) <= probability.keys():
            return
        scene = self.scene(sensors=self.scene()["sensors"][:1])
        every, drawn = self.run_of(scene), self.run_of({**scene, "detection": "constant"})
        types = every.plan.targets.type_code[every.truth.target]
        chances = np.array([probability[name] for name in TARGET_TYPES])[types]
        excess = excess_of_count(len(drawn.lines), chances)
        insist(
            excess <= 1.0,
            f"{len(drawn.lines)} of {len(chances)} looks detect, where {chances.sum():.1f} are due",
            "The look times of a sensor must not depend on the detection model.",
        )

    def test_draws_of_others_are_left_alone(self) -> None:
        """One more sensor of this model changes no event of the others, and a neighbour none of its own."""
        scene = self.scene()
        without = self.run_of({**scene, "sensors": scene["sensors"][1:]})
        others = self.run().lines_of([sensor.id for sensor in without.plan.sensors], without.plan.targets.ids)
        change = "A sensor is built from its own block and context; it keeps nothing that others could see."
        insist_same_lines(without.lines, others, "beside this sensor", change)
        grown = self.run_of({**scene, "sensors": [NEIGHBOUR_SENSOR, *scene["sensors"]]})
        kept = grown.lines_of([SUBJECT], grown.plan.targets.ids)
        own = self.run().lines_of([SUBJECT], grown.plan.targets.ids)
        insist_same_lines(own, kept, "with a neighbour", change)

    def test_a_built_sensor_pickles(self) -> None:
        """The built sensor can be pickled, and its copy looks and moves the same."""
        sensor, here = self.sensor(), self._here()
        copy, time_s, places = insist_pickles(sensor), np.linspace(0.0, 600.0, 7), _places_m(here)
        moves, moved = (one.orbit.position_ecef_m(time_s) for one in (sensor, copy))
        looks, looked = (one.scan.phase_ns(here, places, 0.5) for one in (sensor, copy))
        same = np.array_equal(moves, moved) and np.array_equal(looks, looked)
        insist(same, "a pickled copy moves or looks differently", "Keep all state in fields that pickle.")

    def _here(self) -> FloatArray:
        here: FloatArray = self.sensor().orbit.position_ecef_m(np.zeros(1))[0]
        return here


class ConstellationContract(SensorContract):
    """What a constellation promises: what its sensor model does where its satellites are, and a fleet that runs."""

    @classmethod
    def constellation(cls) -> Constellation:
        """Return the constellation."""
        return cls.host().component(Constellation, cls.name)

    @classmethod
    def component(cls) -> Any:
        """Return the sensor model that the satellites carry."""
        return cls.host().component(SensorModel, cls.constellation().model)

    @classmethod
    def block(cls) -> Mapping[str, Any]:
        """Return the settings of the first satellite."""
        first = {key: value for key, value in cls.constellation().satellites[0].items() if key != "id"}
        return {**first, **cls.settings}

    @classmethod
    def scene(cls, **changes: Any) -> dict[str, Any]:
        """Return the bench's scene with the first satellite."""
        subject = {"model": cls.constellation().model, "id": SUBJECT, **cls.block()}
        certain = {"detection": "always", "classification": "none"}
        return bench_scene(**{"sensors": [subject, *SENSORS[1:]], **certain, **changes})

    def test_the_whole_fleet_runs(self) -> None:
        """A scene that names the constellation has all its satellites, by their ids, each at its own place."""
        run = self.run_of(bench_scene(sensors=[{"constellation": self.name}], classification="none"))
        ids = [row["id"] for row in self.constellation().satellites]
        insist([sensor.id for sensor in run.plan.sensors] == ids, "the fleet is another in a scene", "Check the ids.")
        places = {tuple(sensor.orbit.position_ecef_m(np.zeros(1))[0].tolist()) for sensor in run.plan.sensors}
        insist(
            len(places) == len(ids),
            f"{len(ids)} satellites are at {len(places)} places at the epoch",
            "Give each satellite a slot or an orbit of its own.",
        )


def _place_of(run: BenchRun) -> int:
    return [sensor.id for sensor in run.plan.sensors].index(SUBJECT)


def _places_m(here: FloatArray) -> FloatArray:
    """Return targets (n, 3): a grid over the globe, the poles, the antimeridian, right below and right behind."""
    latitude, longitude = np.radians(np.mgrid[-90:91:30, -180:181:36].reshape(2, -1))
    ring = np.stack(
        [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)], axis=1
    )
    below = here / np.sqrt(np.sum(here**2))
    return 6.45e6 * np.concatenate([ring, [below, -below]])


def _errors_rad(run: BenchRun) -> FloatArray:
    """Return the angles (n,) between measured and true lines of sight; what a sensor's bias adds is true here."""
    plan, seen = run.plan, run.detections
    offset_m = plan.targets.position_ecef_m(run.truth.target, run.truth.emission_time_s) - seen.sensor_ecef_m
    true = offset_m / np.sqrt(np.sum(offset_m**2, axis=1))[:, None]
    if plan.bias is not None:
        x, y, z = true.T
        true = np.stack(plan.bias.applied(x, y, z, seen.sensor, seen.sensor_ecef_m), axis=1)
    # The chord between two unit vectors; for angles this small an inverse cosine would keep no digits.
    chord = np.sqrt(np.sum((seen.line_of_sight_ecef - true) ** 2, axis=1))
    angle: FloatArray = 2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0))
    return angle
