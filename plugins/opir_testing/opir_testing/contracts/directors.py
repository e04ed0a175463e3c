"""Conformance tests of directors."""

import json
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from attrs import evolve

from opir_core.arrays import BoolArray, FloatArray
from opir_core.interfaces import command_fault
from opir_core.plugin import (
    Detections,
    Director,
    DirectorContext,
    DirectorModel,
    Situation,
    Tracks,
)
from opir_testing.bench import (
    NEIGHBOUR_SENSOR,
    NEIGHBOUR_TARGET,
    SENSORS,
    bench_scene,
    planned,
)
from opir_testing.contracts.contract import require
from opir_testing.contracts.scenes import SceneContract
from opir_testing.doubles import stub_estimates, stub_window

#: Distance from the Earth's centre that no ground has, m.
_LEAST_RADIUS_M = 6.3e6

_POINTED = {"model": "generic-pointed", "id": "POINTED", "orbital_slot_deg": -110.0}


class DirectorContract(SceneContract):
    """Conformance tests of a director."""

    kind = DirectorModel
    key = "director"

    @classmethod
    def scene(cls, **changes: Any) -> dict[str, Any]:
        """Return the test scene with the director, a sensor that it points, and a tracker if one is
        installed.
        """
        tracker = "imm" if "imm" in cls.host().names("opir_trackers") else "none"
        director = {"model": cls.name, **cls.block()}
        sensors = [*SENSORS, _POINTED]
        return bench_scene(
            **{"sensors": sensors, "tracker": tracker, "director": director, **changes}
        )

    @classmethod
    def part(cls) -> Any:
        """Return a new director."""
        plan = cls.bare_plan()
        context = DirectorContext(
            sensors=plan.sensors, epoch_us=plan.scene.epoch_us, duration_s=plan.scene.duration_s
        )
        return cls.built(Director, cls.config(), context)

    @classmethod
    @cache
    def bare_plan(cls) -> Any:
        """Return the plan of the scene without the director."""
        scene = cls.scene()
        return planned({key: scene[key] for key in scene if key != cls.key}, cls.host())

    @classmethod
    def situations(cls) -> Mapping[str, Situation]:
        """Return situations by description; their arrays cannot be written."""
        state = [-2.6e6, -4.6e6, 3.6e6, 100.0, -500.0, 900.0]
        of_tracks = {
            "without tracks": Tracks.empty(),
            "with tracks": stub_estimates(
                3, tick_s=[59.0] * 3, state=state, state_covariance=np.eye(6) * 1e6
            ),
            "with tracks without a state": stub_estimates(2, tick_s=[59.0] * 2),
        }
        detections = {"without tracks": Detections.empty()}
        return {
            name: cls.situation(detections.get(name, stub_window(4).detections), tracks)
            for name, tracks in of_tracks.items()
        }

    @classmethod
    def situation(cls, detections: Detections, tracks: Tracks) -> Situation:
        """Return the situation at 60 s, in which sensors reach every place."""
        sensors = tuple(sensor for sensor in cls.bare_plan().sensors if sensor.pointing)
        return Situation(
            time_s=60.0,
            detections=detections.freeze(),
            tracks=tracks.freeze(),
            sensors=sensors,
            refused=(),
            in_reach=_everywhere,
        )

    def test_the_interval_is_positive(self) -> None:
        """The time between decisions is a positive number of seconds."""
        interval_s = self.part().interval_s
        is_time = isinstance(interval_s, int | float) and 0.0 < interval_s < np.inf
        require(is_time, f"interval_s is {interval_s!r}", "Give a positive number of seconds.")

    def test_commands_are_to_sensors_with_a_narrow_field(self) -> None:
        """In every situation it returns commands, to sensors of the situation."""
        for name, situation in self.situations().items():
            commands = self.part().commands(situation)
            fault = command_fault(commands)
            change = "Return a list of opir_core.plugin.Command, empty for none."
            require(not fault, f"{name} it {fault}", change)
            for command in commands:
                _require_place(name, command.position_ecef_m)
            ids = {sensor.id for sensor in situation.sensors}
            others = {command.sensor for command in commands} - ids
            require(
                not others,
                f"{name} it commands {', '.join(sorted(map(repr, others)))}",
                "Command only sensors of situation.sensors, by their ids.",
            )

    def test_commands_have_a_reason(self) -> None:
        """Each command says in one line why it was given."""
        for name, situation in self.situations().items():
            reasons = [command.reason for command in self.part().commands(situation)]
            are_lines = all(reason.strip() and "\n" not in reason for reason in reasons)
            require(are_lines, f"{name} the reasons are {reasons}", "Give each a line of text.")

    def test_detections_are_declared_if_they_are_read(self) -> None:
        """A director with `needs_detections = False` gives the same commands without detections."""
        if self.part().needs_detections:
            return
        for name, situation in self.situations().items():
            bare = evolve(situation, detections=Detections.empty())
            given, without = (str(self.part().commands(each)) for each in (situation, bare))
            require(
                given == without,
                f"{name} needs_detections is False, but detections are read",
                "Set needs_detections = True.",
            )

    def test_results_of_others_do_not_change(self) -> None:
        """An additional sensor and target do not change what sensors that are not pointed detect."""
        scene = self.scene()
        grown = self.run_of(
            {
                **scene,
                "sensors": [NEIGHBOUR_SENSOR, *scene["sensors"]],
                "targets": [NEIGHBOUR_TARGET, *scene["targets"]],
            }
        )
        alone = self.run()
        fixed = [sensor.id for sensor in alone.plan.sensors if not sensor.pointing]
        ids = alone.plan.targets.ids
        detected, again = (
            [json.loads(line)["detection_id"] for line in run.lines_of(fixed, ids)]
            for run in (alone, grown)
        )
        require(
            detected == again,
            f"with a neighbour there are {len(again)} events instead of {len(detected)}",
            "A director changes nothing but where sensors with a narrow field look.",
        )


def _require_place(situation: str, position_m: FloatArray | None) -> None:
    """Require a position (3,), m, if a command has one, that is known and not inside of the Earth."""
    distance_m = _LEAST_RADIUS_M if position_m is None else float(np.linalg.norm(position_m))
    require(
        _LEAST_RADIUS_M <= distance_m < np.inf,
        f"{situation} it points {distance_m / 1000.0:.0f} km from the Earth's centre",
        "Command a position in ECEF, in metres, on or above the ground; leave out tracks whose"
        " state is nan.",
    )


def _everywhere(_sensor: str, position_ecef_m: FloatArray, _after_s: float = 0.0) -> BoolArray:
    return np.ones(len(position_ecef_m), dtype=np.bool_)
