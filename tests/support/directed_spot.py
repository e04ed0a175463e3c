"""A sensor with a field of a degree that a scripted director points, beside a scanning one."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from two_sensor_scene import two_sensor_scene

import opir_core as opir
from opir_core.plugin import (
    Command,
    Director,
    DirectorModel,
    Host,
    PointedSensorConfig,
    PointingConfig,
    SensorModel,
    Situation,
    hookimpl,
    scanning_model,
    with_defaults,
)


@with_defaults(
    bands={"SWIR": (2.5, 3.0)},
    scan_period_ms=100.0,
    detection_probability={"ICBM": 1.0},
    confusion={"ICBM": {"ICBM": 1.0}},
    pointing=PointingConfig(half_angle_deg=0.5, slew_deg_s=1.0, settle_s=3.0, delay_s=2.0),
)
class SpotConfig(PointedSensorConfig):
    """A sensor whose field is a degree wide."""


Decide = Callable[[Situation], Sequence[Command]]


class Script(Director):
    """Gives the commands that a function returns."""

    interval_s = 10.0

    def __init__(self, decide: Decide) -> None:
        self._decide = decide

    def commands(self, situation: Situation) -> Sequence[Command]:
        return self._decide(situation)


class Scripted:
    """A plugin with the sensor `SPOT` and the director `script`."""

    def __init__(self, decide: Decide) -> None:
        self._decide = decide

    @hookimpl
    def opir_sensor_models(self) -> list[SensorModel]:
        return [scanning_model("SPOT", "a spot", SpotConfig)]

    @hookimpl
    def opir_directors(self) -> list[DirectorModel]:
        build = lambda config, context: Script(self._decide)  # noqa: E731
        return [DirectorModel(name="script", summary="a script", build=build)]


def host_of(decide: Decide) -> Host:
    host = Host.discover()
    host.register(Scripted(decide))
    return host


def scene(decide: Decide, **changes: Any) -> opir.Scene:
    sensors = [
        {"model": "generic-scanner", "id": "WIDE", "orbital_slot_deg": -150.0},
        {"model": "SPOT", "id": "SPOT", "orbital_slot_deg": -100.0, **changes.pop("spot", {})},
    ]
    changed = {"duration_s": 120.0, "sensors": sensors, "director": "script", **changes}
    settings = {name: value for name, value in changed.items() if value is not None}
    return opir.scene_from_mapping(two_sensor_scene(**settings), host=host_of(decide))


def run(decide: Decide, **changes: Any) -> opir.Run:
    return opir.simulate(scene(decide, **changes), host_of(decide))


def stay(_situation: Situation) -> Sequence[Command]:
    return []


def spot_times_s(of: opir.Run) -> Any:
    return of.detections.time_ns[of.detections.sensor == 1] * 1e-9


LAUNCH_M = np.array([-2.6536e6, -4.5963e6, 3.5470e6])
ELSEWHERE_M = np.array([-2.6536e6, -4.5963e6, -3.5470e6])


def point_at(position_m: Any, at_s: float = 0.0) -> Decide:
    def decide(situation: Situation) -> Sequence[Command]:
        due = situation.time_s == at_s
        return [Command(sensor="SPOT", position_ecef_m=position_m, reason="test")] if due else []

    return decide


def columns(of: opir.Run) -> list[Any]:
    return [
        of.detections.time_ns,
        of.detections.line_of_sight_ecef,
        of.tracks.state,
        of.tracks.track,
    ]
