"""What every component promises that takes part in a simulation, tested by running the bench's scene with it."""

import json
from collections import Counter
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from attrs import fields

from opir_core.output.events import detection_schema
from opir_core.planning.plan import Plan
from opir_core.scene.fields import info_of
from opir_core.testing.bench import NEIGHBOUR_SENSOR, NEIGHBOUR_TARGET, BenchRun, planned
from opir_core.testing.contracts.comparisons import insist_same_lines
from opir_core.testing.contracts.contract import Broken, Contract, insist
from opir_core.testing.json_schema import faults_in
from opir_core.testing.other_process import lines_elsewhere
from opir_core.testing.watching import asked_of_the_world

_STREAMS = (
    "Draw random numbers only from the dice that are handed in, by a purpose of your own; keep nothing from one call to"
    " the next."
)


#: About so many events are held to the schema, evenly spread over the run.
_LOOKED_AT = 200


class SceneContract(Contract):
    """What holds for every kind that a simulation runs."""

    @classmethod
    @cache
    def plan(cls) -> Plan:
        """Return the plan of the scene: its parts built, nothing run."""
        return planned(cls.scene(), cls.host())

    def test_every_setting_says_what_it_means(self) -> None:
        """Every setting has words that say what it means, and its defaults are lawful."""
        config = self.component().config
        bare = [attribute.name for attribute in fields(config) if not info_of(attribute).help]
        insist(
            not bare,
            f"{config.__name__} has fields that say nothing of themselves: {', '.join(bare)}",
            "Make each field with number, text, flag or nested of opir_core.plugin, with help=, unit= and a range.",
        )
        self.config()

    def test_the_same_seed_gives_the_same_bytes(self) -> None:
        """A run repeated in one process gives the same bytes."""
        change = f"A result depends on what ran before. {_STREAMS}"
        insist_same_lines(self.run().lines, self.run_of(self.scene()).lines, "in a second run", change)

    def test_another_process_and_hash_seed_give_the_same_bytes(self) -> None:
        """Another process, with another hash seed and another history, gives the same bytes."""
        change = f"Do not use hash(), the order of sets, ids of objects or processes, or state of a module. {_STREAMS}"
        elsewhere = lines_elsewhere(self.scene(), self.plugins)
        insist_same_lines(self.run().lines, elsewhere, "in another process", change)

    def test_windows_of_any_size_give_the_same_bytes(self) -> None:
        """The sizes of the windows that a run is cut into change no byte."""
        change = f"A result depends on which rows come in one call. {_STREAMS}"
        for window_s in (3.1, 17.0):
            lines = self.run_of(self.scene(), window_s=window_s).lines
            insist_same_lines(self.run().lines, lines, f"in windows of {window_s} s", change)

    def test_targets_in_any_order_give_the_same_events(self) -> None:
        """The order of targets in the scene changes no event."""
        scene = self.scene()
        lines = self.run_of({**scene, "targets": scene["targets"][::-1]}).lines
        change = f"A result depends on the number of a target, not on the target. {_STREAMS}"
        insist_same_lines(sorted(self.run().lines), sorted(lines), "with the targets in reverse", change)

    def test_draws_of_others_are_left_alone(self) -> None:
        """One more sensor and one more target change nothing for those that are there."""
        scene = self.scene()
        grown = self.run_of(
            {
                **scene,
                "sensors": [NEIGHBOUR_SENSOR, *scene["sensors"]],
                "targets": [NEIGHBOUR_TARGET, *scene["targets"]],
            }
        )
        alone = self.run()
        kept = grown.lines_of([sensor.id for sensor in alone.plan.sensors], alone.plan.targets.ids)
        insist_same_lines(alone.lines, kept, "with a neighbour", f"Neighbours disturb each other's results. {_STREAMS}")

    def test_clock_network_and_global_random_numbers_are_not_asked(self) -> None:
        """Neither the clock, nor entropy, nor the network, nor random numbers that all share, are asked."""
        asked = asked_of_the_world(lambda: self.run_of(self.scene()))
        insist(
            not asked,
            f"it asks {'; '.join(asked[:3])}",
            "Time is scene time, in the columns; random numbers come from the dice; data are read from the package when"
            " the part is built.",
        )

    def test_an_empty_sky_is_no_error(self) -> None:
        """A scene without targets runs, and sees none."""
        run = self.run_of(self.scene(targets=[]))
        found = int(np.sum(run.truth.target >= 0))
        insist(found == 0, f"without targets there are {found} detections of one", "Invent nothing.")

    def test_columns_hold_at_pole_antimeridian_and_far_side(self) -> None:
        """Targets near the pole, across the antimeridian and behind the Earth leave every column lawful."""
        _insist_lawful_columns(self.run())

    def test_events_follow_the_schema(self) -> None:
        """Events follow the schema of detection events."""
        schema, lines = detection_schema(), self.run().lines
        for line in lines[:: 1 + len(lines) // _LOOKED_AT]:
            faults = faults_in(json.loads(line), schema)
            insist(not faults, f"an event breaks the schema: {'; '.join(faults[:3])}", "See opir schema detection.")


def _insist_lawful_columns(run: BenchRun) -> None:
    columns, truth = run.detections, run.truth
    noise = truth.target < 0
    length = np.sqrt(np.sum(columns.line_of_sight_ecef**2, axis=1))
    lawful: Mapping[str, Any] = {
        "line_of_sight_ecef: unit vectors": np.abs(length - 1.0) < 1e-12,
        "sensor_ecef_m: finite": np.isfinite(columns.sensor_ecef_m).all(axis=1),
        "confidence: in [0, 1]": (columns.confidence >= 0.0) & (columns.confidence <= 1.0),
        "reported_type: 0 to 3": columns.reported_type <= 3,
        "snr: nan or finite": ~np.isinf(columns.snr),
        "line_of_sight_sigma_rad: not negative": columns.line_of_sight_sigma_rad >= 0.0,
        "probability: in (0, 1], nan for noise": noise | (truth.probability > 0.0) & (truth.probability <= 1.0),
        "range_m: positive, nan for noise": noise | (truth.range_m > 0.0),
    }
    for promise, kept in lawful.items():
        bad = np.flatnonzero(~kept)
        if len(bad):
            where = Counter("noise" if row < 0 else run.plan.targets.ids[row] for row in truth.target[bad].tolist())
            raise Broken(
                f"{promise}: {len(bad)} of {len(columns)} rows are not (targets {dict(where)})",
                "Look at these targets' geometry: divisions by zero, inverse sines beyond 1, longitudes that wrap.",
            )
