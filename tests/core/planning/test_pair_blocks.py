"""Pairs are compiled in blocks: few calls per sensor, few rows at once, and the same plan whatever
the blocks.
"""

import numpy as np
import pytest
from attrs import define, evolve, field, fields, frozen

import opir_core as opir
from opir_core import Plan, compile_plan
from opir_core.arrays import FloatArray, IntArray
from opir_core.planning import PairCompiler, pair_compiler
from opir_core.planning.sightlines import LIGHT_TIME_ITERATIONS, Pairs, Sightlines
from opir_core.plugin import Orbit, ScanPattern, Sensor

SENSORS = 40
TARGETS = 6


@frozen
class Counted:
    """The rows of each call of a sensor's orbit and of its scan pattern."""

    orbit: list[int] = field(factory=list)
    scan: list[int] = field(factory=list)


@define
class CountingOrbit:
    """An orbit that moves, as far as the plan knows."""

    of: Orbit
    counted: Counted
    is_stationary: bool = False

    def position_ecef_m(self, time_s: FloatArray) -> FloatArray:
        self.counted.orbit.append(len(time_s))
        return self.of.position_ecef_m(time_s)


@define
class CountingScan:
    of: ScanPattern
    counted: Counted

    @property
    def period_ns(self) -> int:
        return self.of.period_ns

    def phase_ns(
        self, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray, uniform: float
    ) -> IntArray:
        self.counted.scan.append(len(target_ecef_m))
        return self.of.phase_ns(sensor_ecef_m, target_ecef_m, uniform)


@pytest.fixture(scope="module")
def plan() -> Plan:
    return compile_plan(
        opir.scene_from_mapping(
            {
                "scene": "blocks",
                "epoch": "2026-04-01T00:00:00Z",
                "duration_s": 250.0,
                "sensors": [
                    {
                        "model": "SBIRS-GEO",
                        "id": f"S{number}",
                        "orbital_slot_deg": 9.0 * number - 180.0,
                    }
                    for number in range(SENSORS)
                ],
                "targets": [
                    {
                        "id": f"T{number}",
                        "type": "ICBM",
                        "launch": {
                            "lat_deg": 10.0 * number,
                            "lon_deg": 5.0 * number,
                            "time_s": 7.3 * number,
                        },
                        "aim": {"lat_deg": -20.0, "lon_deg": 90.0},
                    }
                    for number in range(TARGETS)
                ],
            }
        )
    )


def compiled(plan: Plan, sensors: "list[Sensor] | None" = None) -> tuple[Pairs, Sightlines]:
    chosen_sensors = plan.sensors if sensors is None else sensors
    return PairCompiler(
        chosen_sensors, plan.targets, [0.25] * len(chosen_sensors), True, plan.end_ns
    ).compiled()


@pytest.mark.slow
@pytest.mark.parametrize("points", [1, 700, 10**9])
def test_the_plan_does_not_depend_on_the_blocks(
    plan: Plan, points: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    pairs, lines = compiled(plan)
    monkeypatch.setattr(pair_compiler, "BLOCK_POINTS", points)
    same_pairs, same_lines = compiled(plan)
    for record, same_record in ((pairs, same_pairs), (lines, same_lines)):
        for column in fields(type(record)):
            actual, expected = (
                np.asarray(getattr(columns, column.name)) for columns in (record, same_record)
            )
            assert np.array_equal(actual, expected, equal_nan=actual.dtype.kind == "f")


def test_pair_blocks_make_a_call_per_sensor_and_step(
    plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The orbit: at ignition and end of each step of the light time, twice on the coarse grid, and
    on the fine grid for pairs that the Earth does not hide; the scan pattern: once."""
    monkeypatch.setattr(pair_compiler, "BLOCK_POINTS", 10**9)
    counted, sensors = _counting(plan)
    compiled(plan, sensors)
    assert {len(calls.orbit) for calls in counted} == {3, LIGHT_TIME_ITERATIONS + 3}
    assert {tuple(calls.scan) for calls in counted} == {(TARGETS,)}


def test_a_sensor_at_rest_is_asked_for_its_position_once(plan: Plan) -> None:
    counted, sensors = _counting(plan, is_stationary=True)
    compiled(plan, sensors)
    assert {tuple(calls.orbit) for calls in counted} == {(1,)}


def test_no_block_has_more_rows_than_its_limit_and_one_pair(
    plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    limit = 700
    longest = int((plan.targets.burnout_s - plan.targets.ignition_s).max()) + 3
    monkeypatch.setattr(pair_compiler, "BLOCK_POINTS", limit)
    rows: list[int] = []
    margins_of = pair_compiler.Margins.of

    def counting(
        half: FloatArray, least: FloatArray, sensor_m: FloatArray, target_m: FloatArray
    ) -> object:
        rows.append(len(target_m))
        return margins_of(half, least, sensor_m, target_m)

    monkeypatch.setattr(pair_compiler.Margins, "of", counting)
    compiled(plan)
    assert max(rows) <= limit + longest
    assert len(rows) > 10


def test_lines_of_sight_cover_only_the_time_of_the_looks(plan: Plan) -> None:
    pairs, lines = compiled(plan)
    looking = pairs.take(np.flatnonzero(pairs.looks > 0))
    assert 0 < len(looking) < len(pairs)
    first_s, last_s = (
        np.floor((looking.phase_ns + scan * looking.period_ns) * 1e-9)
        for scan in (looking.first_scan, looking.last_scan)
    )
    assert len(lines.travel_s) == (last_s - first_s + 2).sum()


def _counting(plan: Plan, *, is_stationary: bool = False) -> tuple[list[Counted], list[Sensor]]:
    counted = [Counted() for _ in plan.sensors]
    sensors = [
        evolve(
            sensor,
            orbit=CountingOrbit(sensor.orbit, calls, is_stationary),
            scan=CountingScan(sensor.scan, calls),
        )
        for sensor, calls in zip(plan.sensors, counted, strict=True)
    ]
    return counted, sensors
