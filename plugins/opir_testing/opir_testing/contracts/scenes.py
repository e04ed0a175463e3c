"""Conformance tests of all components that take part in a simulation: they run the test scene with
the component.
"""

import json
from collections import Counter
from collections.abc import Mapping
from functools import cache
from typing import Any, ClassVar

import numpy as np

from opir_core import Plan, reseeded
from opir_core.output import detection_schema
from opir_testing.bench import (
    NEIGHBOUR_SENSOR,
    NEIGHBOUR_TARGET,
    BenchRun,
    LookTable,
    bench_run_of,
    bench_scene,
    planned,
)
from opir_testing.contracts.contract import (
    REPEAT,
    ConformanceError,
    Contract,
    require,
    require_no_outside_inputs,
    require_same_events,
)
from opir_testing.json_schema import schema_errors
from opir_testing.other_process import events_in_other_process

_STREAMS = (
    "Draw random numbers only from the argument `rng`, with a purpose of your own; keep no state"
    " between calls."
)

#: The approximate number of events that are validated against the schema, evenly spread over the
#: run.
_VALIDATED = 200


class SceneContract(Contract):
    """Conformance tests of all components that take part in a simulation; `key` is that of a scene
    that chooses one.
    """

    key: ClassVar[str] = ""

    @classmethod
    def scene(cls, **changes: Any) -> dict[str, Any]:
        """Return the test scene with the component; `changes` replace keys."""
        return bench_scene(**{cls.key: {"model": cls.name, **cls.block()}, **changes})

    @classmethod
    @cache
    def plan(cls) -> Plan:
        """Return the plan of the scene."""
        return planned(cls.scene(), cls.host())

    @classmethod
    @cache
    def looks(cls) -> LookTable:
        """Return all looks of the scene."""
        return LookTable.of(cls.plan())

    def exercise(self) -> object:
        """Run the scene."""
        return self.run_of(self.scene())

    def test_the_same_seed_gives_the_same_bytes(self) -> None:
        """A second run in the same process gives the same bytes."""
        change = f"A result depends on earlier runs. {_STREAMS}"
        require_same_events(
            self.run().lines, self.run_of(self.scene()).lines, "in a second run", change, REPEAT
        )

    def test_another_process_and_hash_seed_give_the_same_bytes(self) -> None:
        """Another process with another hash seed gives the same bytes."""
        change = (
            f"Do not use hash(), the order of sets, ids of objects or processes, or module state."
            f" {_STREAMS}"
        )
        elsewhere = events_in_other_process(self.scene(), self.plugins)
        require_same_events(self.run().lines, elsewhere, "in another process", change, REPEAT)

    def test_what_replicates_share_does_not_use_the_seed(self) -> None:
        """A plan of another seed, with what no seed changes taken over, gives the bytes of one that
        is made anew.
        """
        seed = self.plan().scene.seed + 1
        shared = bench_run_of(reseeded(self.plan(), seed)).lines
        change = (
            "Set uses_seed = True where a detection model or an atmosphere is built from the seed."
        )
        require_same_events(
            self.run_of(self.scene(seed=seed)).lines, shared, "in a replicate", change
        )

    def test_windows_of_any_size_give_the_same_bytes(self) -> None:
        """The window size changes no byte."""
        change = f"A result depends on which rows are in the same call. {_STREAMS}"
        for window_s in (3.1, 17.0):
            lines = self.run_of(self.scene(), window_s=window_s).lines
            require_same_events(self.run().lines, lines, f"in windows of {window_s} s", change)

    def test_targets_in_any_order_give_the_same_events(self) -> None:
        """The order of targets in the scene changes no event."""
        scene = self.scene()
        lines = self.run_of({**scene, "targets": scene["targets"][::-1]}).lines
        change = f"A result depends on the index of a target. {_STREAMS}"
        require_same_events(
            sorted(self.run().lines), sorted(lines), "with the targets in reverse", change
        )

    def test_results_of_others_do_not_change(self) -> None:
        """An additional sensor and target do not change the events of the others."""
        scene = self.scene()
        grown = self.run_of(
            {
                **scene,
                "sensors": [NEIGHBOUR_SENSOR, *scene["sensors"]],
                "targets": [NEIGHBOUR_TARGET, *scene["targets"]],
            }
        )
        alone = self.run()
        lines = grown.lines_of([sensor.id for sensor in alone.plan.sensors], alone.plan.targets.ids)
        require_same_events(
            alone.lines, lines, "with a neighbour", f"Results depend on others. {_STREAMS}"
        )

    def test_clock_network_and_global_random_state_are_not_used(self) -> None:
        """Clock, entropy, environment, network and global random state are not used."""
        change = (
            "Take times from the columns and random numbers from `rng`; read package data in build."
        )
        require_no_outside_inputs(self.use(), change)

    def test_a_scene_without_targets_runs(self) -> None:
        """A scene without targets runs and has no detection of a target."""
        run = self.run_of(self.scene(targets=[]))
        count = int(np.sum(run.truth.target >= 0))
        require(
            count == 0,
            f"without targets there are {count} detections of one",
            "Detect only what is in view.",
        )

    def test_columns_are_valid_at_pole_antimeridian_and_far_side(self) -> None:
        """Columns are valid for targets near the pole, across the antimeridian and behind the
        Earth.
        """
        _require_valid_columns(self.run())

    def test_events_follow_the_schema(self) -> None:
        """Events conform to the schema of detection events."""
        schema = detection_schema(is_closed=True)
        lines = self.run().lines
        for line in lines[:: 1 + len(lines) // _VALIDATED]:
            errors = schema_errors(json.loads(line), schema)
            require(
                not errors,
                f"an event violates the schema: {'; '.join(errors[:3])}",
                "See opir schema detection.",
            )


def _require_valid_columns(run: BenchRun) -> None:
    columns = run.detections
    truth = run.truth
    is_false_alarm = truth.target < 0
    length = np.sqrt(np.sum(columns.line_of_sight_ecef**2, axis=1))
    valid: Mapping[str, Any] = {
        "line_of_sight_ecef: unit vectors": np.abs(length - 1.0) < 1e-12,
        "sensor_ecef_m: finite": np.isfinite(columns.sensor_ecef_m).all(axis=1),
        "confidence: in [0, 1]": (columns.confidence >= 0.0) & (columns.confidence <= 1.0),
        "reported_type: 0 to 3": columns.reported_type <= 3,
        "snr: nan or finite": ~np.isinf(columns.snr),
        "line_of_sight_sigma_rad: not negative": columns.line_of_sight_sigma_rad >= 0.0,
        "probability: in (0, 1], nan for false alarms": is_false_alarm
        | (truth.probability > 0.0) & (truth.probability <= 1.0),
        "range_m: positive, nan for false alarms": is_false_alarm | (truth.range_m > 0.0),
    }
    for condition, holds in valid.items():
        failing = np.flatnonzero(~holds)
        if len(failing):
            targets = Counter(
                "false alarm" if row < 0 else run.plan.targets.ids[row]
                for row in truth.target[failing].tolist()
            )
            raise ConformanceError(
                f"{condition}: not in {len(failing)} of {len(columns)} rows (targets {dict(targets)})",
                "Check the geometry of these targets: division by zero, arcsine beyond 1,"
                " longitudes that wrap.",
            )
