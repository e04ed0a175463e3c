"""Conformance tests of target classes."""

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from opir_core.plugin import REPORTED_TYPES, BoostProfile, OrbitInsertion, TargetClass, TargetModel
from opir_testing.bench import bench_scene
from opir_testing.contracts.contract import require
from opir_testing.contracts.targets import TargetContract

#: In full view of the test scene's sensors; flights go west.
_LAUNCH = {"lat_deg": 34.7, "lon_deg": -120.6}
_BEARING_RAD = math.radians(275.0)
_RADIUS_M = 6.371e6

#: Shares of the way from the shortest to the longest range of a profile.
_SHARES = (0.02, 0.5, 0.98)


class TargetClassContract(TargetContract):
    """Conformance tests of a target class: those of its target model with flights of the class.

    Each profile flies three ranges within its limits, or a class into orbit at three azimuths;
    `settings` are added to each target.
    """

    @classmethod
    def target_class(cls) -> TargetClass:
        """Return the target class."""
        return cls.host().component(TargetClass, cls.name)

    @classmethod
    def offered(cls) -> Any:
        """Return the target class."""
        return cls.target_class()

    @classmethod
    def component(cls) -> Any:
        """Return the target model for what follows burnout."""
        return cls.host().component(TargetModel, cls.target_class().after_burnout.model)

    @classmethod
    @cache
    def blocks(cls) -> list[dict[str, Any]]:
        """Return the blocks of the targets: three flights of each profile, or into orbit."""
        model = cls.target_class().after_burnout.model
        if model == OrbitInsertion.model:
            flights = list(_ascents())
        else:
            flights = [
                flight for profile in cls.target_class().profiles for flight in _flights(profile)
            ]
        return [
            {"id": f"T{number}", "model": model, "type": cls.name, **flight, **cls.settings}
            for number, flight in enumerate(flights, start=1)
        ]

    def test_burns_are_those_of_the_profiles(self) -> None:
        """Burns last as long as those of the class's profiles."""
        trajectories = self.targets()
        known_s = np.array([profile.burn_time_s for profile in self.target_class().profiles])
        burn_s = trajectories.burnout_s - trajectories.ignition_s
        away_s = np.abs(burn_s[:, None] - known_s).min(axis=1)
        require(
            "burn_time_s" in self.settings or bool(np.all(away_s < 1e-9)),
            f"burns last {burn_s.tolist()} s, those of the profiles {known_s.tolist()} s",
            "Give each profile range limits that no other profile of the class covers first.",
        )

    def test_the_truth_names_the_class(self) -> None:
        """The truth has the class of each target, and one of its profiles."""
        names = {profile.name for profile in self.target_class().profiles}
        truth = self.targets().truth()
        require(
            all(row["type"] == self.name and row["profile"] in names for row in truth),
            f"the truth has {[(row['type'], row['profile']) for row in truth]}",
            "Do not set `profile` in the settings of the test.",
        )

    def test_sensors_that_do_not_name_the_class_detect_it(self) -> None:
        """A sensor without a probability of detection for the class detects it like the type that
        it resembles.
        """
        kind = self.target_class()
        run = self.run()
        sensor, target = (
            grid.ravel().astype(np.int32)
            for grid in np.indices((len(run.plan.sensors), len(self.blocks())))
        )
        expected = [run.plan.sensors[row].detection_probability for row in sensor.tolist()]
        chance = run.plan.detection.pair_probability(sensor, target)
        expected_values = np.array(
            [values.get(kind.name, values[kind.resembles]) for values in expected]
        )
        require(
            len(run.lines) > 0 and chance is not None and np.array_equal(chance, expected_values),
            f"{len(run.lines)} detections, with probabilities {chance}",
            "Set `resembles` to a missile type that sensors have a probability of detection for.",
        )

    def test_the_right_type_is_reported(self) -> None:
        """The classifier `always` reports the reported type of the class."""
        right = REPORTED_TYPES.index(self.target_class().reported_type)
        reported = self.run_of(self.scene(classification="always")).detections.reported_type
        require(
            bool(np.all(reported == right)),
            f"reported types are {sorted(set(reported.tolist()))}, not {right}",
            "Set `reported_type` to one of ICBM, IRBM, SRBM and UNKNOWN.",
        )

    def test_plumes_are_seen(self) -> None:
        """With detection: snr, the class's default plumes are detected."""
        run = self.run_of(
            bench_scene(targets=self.blocks(), detection="snr", classification="none")
        )
        detected = {
            run.plan.targets.ids[target] for target in run.truth.target.tolist() if target >= 0
        }
        dark = [block["id"] for block in self.blocks() if block["id"] not in detected]
        require(
            not dark,
            f"targets {dark} are never detected",
            "Give the plume intensities of its class, in W/sr.",
        )


def _flights(profile: BoostProfile) -> Sequence[Mapping[str, Any]]:
    """Return launch and aim of flights over the ranges of a profile."""
    span_m = profile.maximum_range_m - profile.minimum_range_m
    ranges_m = [profile.minimum_range_m + share * span_m for share in _SHARES]
    return [
        {"launch": {**_LAUNCH, "time_s": 2.0 + number}, "aim": _place(range_m)}
        for number, range_m in enumerate(ranges_m)
    ]


def _ascents() -> Iterator[Mapping[str, Any]]:
    """Yield launch and azimuth of flights into orbit: with, across and against the rotation of the
    Earth.
    """
    for number, azimuth_deg in enumerate((90.0, 180.0, 270.0)):
        yield {"launch": {**_LAUNCH, "time_s": 2.0 + number}, "azimuth_deg": azimuth_deg}


def _place(range_m: float) -> Mapping[str, float]:
    """Return the place at a distance along a great circle of the sphere, which is within 0.4 % of
    the geodesic's.
    """
    way = range_m / _RADIUS_M
    start = math.radians(_LAUNCH["lat_deg"])
    sine = math.sin(start) * math.cos(way) + math.cos(start) * math.sin(way) * math.cos(
        _BEARING_RAD
    )
    east = math.sin(_BEARING_RAD) * math.sin(way) * math.cos(start)
    longitude_deg = _LAUNCH["lon_deg"] + math.degrees(
        math.atan2(east, math.cos(way) - math.sin(start) * sine)
    )
    return {
        "lat_deg": math.degrees(math.asin(sine)),
        "lon_deg": (longitude_deg + 180.0) % 360.0 - 180.0,
    }
