"""Conformance tests of target models."""

import json
from collections.abc import Mapping, Sequence
from functools import cache, partial
from typing import Any, ClassVar

import numpy as np

from opir_core.arrays import FloatArray, IndexArray
from opir_core.interfaces import has_own
from opir_core.plugin import (
    EMITTER_TYPES,
    TargetClass,
    TargetContext,
    TargetModel,
    Trajectories,
)
from opir_testing.bench import NEIGHBOUR_TARGET, TARGETS, bench_scene
from opir_testing.contracts.contract import (
    ConformanceError,
    read_config,
    require,
    require_array_computation,
    require_equal,
    require_independent_rows,
    require_near,
    require_same_copy,
    require_same_events,
)
from opir_testing.contracts.scenes import SceneContract

_SPEED_LIMIT_M_S = 1.2e4
#: The limit for which the core's visibility is exact (`opir_core.planning.visibility`).
_ACCELERATION_LIMIT_M_S2 = 100.0
_LEAST_RADIUS_M = 6.35e6


class TargetContract(SceneContract):
    """Conformance tests of a target model.

    `launches` are target blocks, each with an `id`; `settings` are added to each. The default ones
    have type, launch and aim.
    """

    kind = TargetModel
    launches: ClassVar[Sequence[Mapping[str, Any]]] = TARGETS

    @classmethod
    def blocks(cls) -> list[dict[str, Any]]:
        """Return the blocks of the targets in the scene."""
        return [{**launch, "model": cls.name, **cls.settings} for launch in cls.launches]

    @classmethod
    def block(cls) -> Mapping[str, Any]:
        """Return the settings of the first target."""
        return {key: value for key, value in cls.blocks()[0].items() if key not in ("id", "model")}

    @classmethod
    def scene(cls, **changes: Any) -> dict[str, Any]:
        """Return the test scene with targets of the model."""
        return bench_scene(**{"targets": cls.blocks(), **changes})

    @classmethod
    def made(
        cls, blocks: Sequence[Mapping[str, Any]], *, free_flight: bool = False
    ) -> Trajectories:
        """Return the trajectories of target blocks; with `free_flight` a sensor follows them after
        burnout.
        """
        settings = [
            {key: value for key, value in block.items() if key not in ("id", "model")}
            for block in blocks
        ]
        context = TargetContext(
            ids=tuple(block["id"] for block in blocks),
            paths=tuple(f"targets[{number}]" for number in range(len(blocks))),
            free_flight=free_flight,
            target_class=partial(cls.host().component, TargetClass),
        )
        configs = [read_config(cls.component(), block) for block in settings]
        return cls.built(Trajectories, configs, context)

    @classmethod
    @cache
    def targets(cls) -> Trajectories:
        """Return the trajectories of the scene's targets."""
        return cls.made(cls.blocks())

    @classmethod
    def part(cls) -> Any:
        """Return the trajectories of the scene's targets."""
        return cls.targets()

    def test_types_and_times_are_valid(self) -> None:
        """Each target has a known type, and a burnout after its ignition."""
        trajectories = self.targets()
        rows = len(self.blocks())
        require(
            trajectories.type_code.shape
            == trajectories.ignition_s.shape
            == trajectories.burnout_s.shape
            == (rows,),
            f"{rows} targets have {trajectories.type_code.shape} types and {trajectories.ignition_s.shape}"
            f" ignitions",
            "Return one row for each configuration, in their order.",
        )
        require(
            np.all(trajectories.type_code < len(EMITTER_TYPES))
            and np.all(trajectories.burnout_s > trajectories.ignition_s),
            "a type is unknown, or a burn ends before it begins",
            "type_code is an index into TARGET_TYPES; burnout_s comes after ignition_s.",
        )

    def test_burns_are_in_order_from_ignition_to_burnout(self) -> None:
        """The burns of a model with `burns_s` are in order, from ignition to burnout, filled up
        with nan.
        """
        trajectories = self.targets()
        if not has_own(Trajectories, trajectories, "burns_s"):
            return
        change = (
            "Return (n, k, 2): ignition and burnout of each burn from ignition_s to burnout_s, then"
            " nan."
        )
        rows = len(self.blocks())
        require(
            np.ndim(trajectories.burns_s) == 3 and trajectories.burns_s.shape[::2] == (rows, 2),
            f"burns_s has the shape {np.shape(trajectories.burns_s)}",
            change,
        )
        for row in range(rows):
            burns = trajectories.burns_s[row][np.isfinite(trajectories.burns_s[row]).all(axis=1)]
            first_burns = trajectories.burns_s[row, : len(burns)]
            ends = (trajectories.ignition_s[row], trajectories.burnout_s[row])
            require(
                len(burns) > 0
                and np.array_equal(first_burns, burns)
                and (burns[0, 0], burns[-1, 1]) == ends
                and bool(
                    np.all(np.diff(burns.ravel()) >= 0.0) and np.all(burns[:, 1] > burns[:, 0])
                ),
                f"the burns of target {row} are {burns.tolist()}, with ignition and burnout at"
                f" {ends}",
                change,
            )

    def test_positions_are_finite_during_the_burn_only(self) -> None:
        """Positions are finite from ignition to burnout inclusive, and nan before and after."""
        trajectories = self.targets()
        for row in range(len(self.blocks())):
            start = float(trajectories.ignition_s[row])
            end = float(trajectories.burnout_s[row])
            inside = trajectories.position_ecef_m(*_at(row, np.linspace(start, end, 101)))
            outside = trajectories.position_ecef_m(*_at(row, np.array([start - 1.0, end + 1.0])))
            require(
                np.isfinite(inside).all() and np.isnan(outside).all(),
                f"target {row} has a position outside its burn, or none inside",
                "Return (n, 3) that is finite at ignition_s <= time_s <= burnout_s and nan"
                " elsewhere.",
            )

    def test_free_flight_extends_to_end_s_and_burns_do_not_change(self) -> None:
        """Positions of a model with `end_s` extend to it if a sensor follows bodies; the burn does
        not change.
        """
        alone = self.targets()
        followed = self.made(self.blocks(), free_flight=True)
        if not has_own(Trajectories, followed, "end_s"):
            return
        for row in range(len(self.blocks())):
            start, burnout, end = (
                float(v[row]) for v in (alone.ignition_s, alone.burnout_s, followed.end_s)
            )
            flight = followed.position_ecef_m(*_at(row, np.linspace(start, end, 101)))
            position = followed.position_ecef_m(*_at(row, np.array([end + 1.0])))
            require(
                end >= burnout and np.isfinite(flight).all() and np.isnan(position).all(),
                f"target {row} has no position before end_s, or one after it",
                "Return positions from ignition_s to end_s, both included, and nan elsewhere.",
            )
            burn = _at(row, np.linspace(start, burnout, 101))
            require(
                followed.position_ecef_m(*burn).tobytes() == alone.position_ecef_m(*burn).tobytes(),
                f"target {row} has other positions in its burn if a sensor follows it",
                "Compute the burn in the same way with and without free flight.",
            )

    def test_paths_are_above_the_ground_and_smooth(self) -> None:
        """Positions are above the ground and continuous, with bounded speed and acceleration."""
        trajectories = self.targets()
        for row in range(len(self.blocks())):
            time_s = np.arange(
                float(trajectories.ignition_s[row]), float(trajectories.burnout_s[row]), 0.5
            )
            place_m = trajectories.position_ecef_m(*_at(row, time_s))
            velocity = np.diff(place_m, axis=0) / 0.5
            speed = np.abs(velocity).max()
            turn = np.abs(np.diff(velocity, axis=0)).max() / 0.5
            radius_m = np.sqrt(np.sum(place_m**2, axis=1))
            require(
                radius_m.min() > _LEAST_RADIUS_M
                and speed < _SPEED_LIMIT_M_S
                and turn < _ACCELERATION_LIMIT_M_S2,
                f"target {row} comes to {radius_m.min():.0f} m of the Earth's centre, flies at up"
                f" to {speed:.0f} m/s and changes speed by up to {turn:.0f} m/s in a second",
                "Positions are ECEF, metres, continuous, with accelerations below 100 m/s2.",
            )

    def test_flights_begin_at_their_launch_points(self) -> None:
        """A target with a `launch` in its block is there at ignition."""
        trajectories = self.targets()
        for row, block in enumerate(self.blocks()):
            start_s = trajectories.ignition_s[row : row + 1]
            require_near(
                f"at ignition target {row} is",
                trajectories.position_ecef_m(*_at(row, start_s))[0],
                block.get("launch", {}),
                "its launch point",
            )

    def test_positions_are_independent(self) -> None:
        """The position of a target at a time does not depend on the other rows of the call."""
        trajectories = self.targets()
        count = len(self.blocks())
        target = np.tile(np.arange(count, dtype=np.int32), 41)
        share = np.repeat(np.linspace(0.0, 1.0, 41), count)
        time_s = (
            trajectories.ignition_s[target]
            + share * (trajectories.burnout_s - trajectories.ignition_s)[target]
        )
        require_independent_rows(
            "position_ecef_m",
            lambda rows: trajectories.position_ecef_m(target[rows], time_s[rows]),
            len(target),
        )

    def test_targets_are_independent(self) -> None:
        """A target built alone has the same trajectory as among others."""
        trajectories = self.targets()
        for row, block in enumerate(self.blocks()):
            alone = self.made([block])
            time_s = np.linspace(
                float(trajectories.ignition_s[row]), float(trajectories.burnout_s[row]), 23
            )
            together = trajectories.position_ecef_m(*_at(row, time_s))
            is_equal = np.array_equal(
                alone.position_ecef_m(*_at(0, time_s)), together, equal_nan=True
            )
            require_equal(
                is_equal,
                f"target {row} has another trajectory alone",
                "Compute each target from its own configuration.",
            )

    def test_truth_is_plain_values(self) -> None:
        """The truth has one mapping of plain values per target."""
        truth = self.targets().truth()
        try:
            json.dumps([dict(row) for row in truth], allow_nan=False)
        except (TypeError, ValueError) as error:
            raise ConformanceError(
                f"the truth is not plain values: {error}", "Return numbers, text and lists; no nan."
            ) from error
        require(
            len(truth) == len(self.blocks()),
            f"the truth has {len(truth)} rows",
            "Return one mapping a target.",
        )

    def test_times_are_computed_as_arrays(self) -> None:
        """The number of Python steps does not grow with the times: computations are on arrays."""
        trajectories = self.targets()
        span = (float(trajectories.ignition_s[0]), float(trajectories.burnout_s[0]))
        require_array_computation(
            "time",
            lambda rows: trajectories.position_ecef_m(*_at(0, np.linspace(*span, rows))),
            100,
            1000,
        )

    def test_results_of_others_do_not_change(self) -> None:
        """A target of another model does not change the events of targets of this model."""
        grown = self.run_of(self.scene(targets=[NEIGHBOUR_TARGET, *self.blocks()]))
        ids = [block["id"] for block in self.blocks()]
        lines = grown.lines_of([sensor.id for sensor in grown.plan.sensors], ids)
        change = "Build each target from its own block; share no state."
        require_same_events(self.run().lines, lines, "with a neighbour", change)

    def test_built_targets_pickle(self) -> None:
        """The built trajectories can be pickled, and their copy returns the same."""
        trajectories = self.targets()
        moments = _at(
            0, np.linspace(float(trajectories.ignition_s[0]), float(trajectories.burnout_s[0]), 11)
        )
        require_same_copy(trajectories, lambda targets: targets.position_ecef_m(*moments))


def _at(row: int, time_s: FloatArray) -> tuple[IndexArray, FloatArray]:
    return np.full(len(time_s), row, dtype=np.int32), time_s
