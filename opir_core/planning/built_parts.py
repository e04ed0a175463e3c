"""What components build: checks of types, shapes, units and ranges; problems, collected."""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from attrs import define, evolve, field

from opir_core.errors import Problem, SceneError, kind_of
from opir_core.host.boundary import blamed_call, check_hint, owner_text
from opir_core.host.host import Host
from opir_core.interfaces.sensors import Sensor
from opir_core.interfaces.trajectories import Trajectories
from opir_core.scene.scene import EMITTER_TYPES, MAXIMUM_BANDS, Choice

#: No satellite is nearer to the Earth's centre, m; positions in km are.
_LEAST_RADIUS_M = 1e5
#: No target flies deeper than this, m, nor beyond the Moon.
_LEAST_TARGET_RADIUS_M = 6.2e6
_MOST_TARGET_RADIUS_M = 1e9
#: Burns begin and end within a year of the scene's start, s: every second of them is sampled.
LATEST_S = 31_557_600.0
#: Lines of sight are more accurate than this, rad; other units are not.
_MOST_SIGMA_RAD = 0.5
_SUM_ROUNDING = 1e-6

#: The ranges of a sensor's numbers.
_RANGES = {
    "field_of_regard_half_angle_rad": (0.0, math.pi),
    "minimum_elevation_rad": (-0.5 * math.pi - 1e-9, 0.5 * math.pi + 1e-9),
    "line_of_sight_sigma_rad": (0.0, _MOST_SIGMA_RAD),
    "line_of_sight_bias_sigma_rad": (0.0, _MOST_SIGMA_RAD),
    "solar_exclusion_rad": (0.0, math.pi),
}

#: The methods of `opir_core.interfaces.trackers.Tracker`.
_TRACKER_METHODS = ("associate(detections)", "step(tick_s, detections)")


def sensor_fault(sensor: Any) -> str:
    """Return the first error of a sensor, or ""; calls its orbit once."""
    if not isinstance(sensor, Sensor):
        return f"{kind_of(sensor)}, no opir_core.plugin.Sensor"
    for name, (low, high) in _RANGES.items():
        value = getattr(sensor, name)
        if not isinstance(value, int | float | np.floating) or not low <= value <= high:
            return f"a sensor with {name} {value!r}; [{low:.4g}, {high:.4g}] is required"
    period_ns: Any = sensor.scan.period_ns
    if not isinstance(period_ns, int | np.integer) or period_ns < 1:
        return f"a sensor with scan.period_ns {period_ns!r}; a positive whole number is required"
    if not 1 <= len(sensor.bands) <= MAXIMUM_BANDS:
        return f"a sensor with {len(sensor.bands)} bands; 1 to {MAXIMUM_BANDS} are required"
    return _orbit_fault(sensor) or _probability_fault(sensor) or _mode_fault(sensor)


def _orbit_fault(sensor: Sensor) -> str:
    position_m: Any = sensor.orbit.position_ecef_m(np.zeros(1))
    if not isinstance(position_m, np.ndarray) or position_m.shape != (1, 3):
        return (
            f"a sensor whose orbit returns {getattr(position_m, 'shape', kind_of(position_m))} for"
            f" one time, not (1, 3)"
        )
    radius_m = float(np.sqrt(np.square(position_m).sum()))
    if not _LEAST_RADIUS_M <= radius_m < math.inf:
        return (
            f"a sensor whose orbit is {radius_m:g} m from the Earth's centre; positions are in"
            f" metres"
        )
    return ""


def _mode_fault(sensor: Sensor) -> str:
    modes: Mapping[str, Any] = sensor.modes
    for name, mode in modes.items():
        is_sensor = isinstance(mode, Sensor) and mode.pointing and sensor.pointing
        if not is_sensor or mode.id == sensor.id:
            return (
                f"a sensor whose mode {name!r} is not, like itself, an opir_core.plugin.Sensor with"
                " pointing, with an id of its own"
            )
    return ""


def _probability_fault(sensor: Sensor) -> str:
    for kind, chance in sensor.detection_probability.items():
        if not 0.0 <= chance <= 1.0:
            return f"a sensor with detection_probability {chance!r} of {kind}; [0, 1] is required"
    for kind, row in sensor.confusion.items():
        total = sum(row.values())
        if min(row.values(), default=0.0) < 0.0 or not abs(total - 1.0) <= _SUM_ROUNDING:
            return (
                f"a sensor with a confusion of {kind} that sums to {total:g}, not to 1, or has"
                f" negative values"
            )
    return ""


def trajectories_fault(trajectories: Any, count: int) -> str:
    """Return the first error in the columns of the trajectories of `count` targets, or ""."""
    for name, kinds in {"type_code": "iu", "ignition_s": "f", "burnout_s": "f"}.items():
        column = getattr(trajectories, name, None)
        if (
            not isinstance(column, np.ndarray)
            or column.dtype.kind not in kinds
            or column.shape != (count,)
        ):
            numbers = "whole numbers" if kinds == "iu" else "floats"
            return (
                f"{name} as {getattr(column, 'shape', kind_of(column))}; {count} {numbers} are"
                f" required"
            )
    if count and trajectories.type_code.max() >= len(EMITTER_TYPES):
        return (
            f"the type_code {trajectories.type_code.max()}; codes are 0 to {len(EMITTER_TYPES) - 1}"
        )
    if not np.isfinite(trajectories.ignition_s).all() or np.isnan(trajectories.burnout_s).any():
        return "times that are not finite"
    return ""


def motion_fault(trajectories: Trajectories, ids: Sequence[str]) -> str:
    """Return the first error in the times, names and positions of the trajectories of targets, or
    "".

    Calls `position_ecef_m` once, for each target at ignition, halfway and at burnout.
    """
    count = len(ids)
    ignition_s = trajectories.ignition_s
    burnout_s = trajectories.burnout_s
    invalid_ends = np.flatnonzero(
        ~((burnout_s >= ignition_s) & (burnout_s <= LATEST_S) & (ignition_s >= -LATEST_S))
    )
    if invalid_ends.size:
        row = invalid_ends[0]
        span = f"from {ignition_s[row]:g} to {burnout_s[row]:g} s"
        return (
            f"{ids[row]} burning {span}; a burn ends after it begins, and both are within a year of"
            f" 0"
        )
    end_s: Any = trajectories.end_s
    burns_s: Any = trajectories.burns_s
    names: Any = trajectories.class_names
    warnings: Any = trajectories.warnings
    if (
        not isinstance(end_s, np.ndarray)
        or end_s.shape != (count,)
        or not (end_s >= burnout_s).all()
    ):
        return (
            f"end_s as {getattr(end_s, 'shape', kind_of(end_s))}; {count} times from burnout on are"
            f" required"
        )
    glow_end_s = np.asarray(trajectories.glow_end_s)
    if (
        glow_end_s.shape != (count,)
        or not ((burnout_s <= glow_end_s) & (glow_end_s <= end_s)).all()
    ):
        return f"glow_end_s as {glow_end_s.shape}; {count} times from burnout to end_s are required"
    if not isinstance(burns_s, np.ndarray) or burns_s.ndim != 3 or burns_s.shape[::2] != (count, 2):
        return (
            f"burns_s as {getattr(burns_s, 'shape', kind_of(burns_s))}; ({count}, k, 2) is required"
        )
    if not isinstance(names, Sequence) or len(names) != count:
        return f"class_names {names!r}; {count} names are required"
    if not isinstance(warnings, Sequence):
        return f"warnings as {kind_of(warnings)}; a list of problems is required"
    target = np.tile(np.arange(count, dtype=np.int32), 3)
    time_s = np.concatenate([ignition_s, 0.5 * (ignition_s + burnout_s), burnout_s])
    return (
        positions_fault(trajectories.position_ecef_m(target, time_s), len(target)) if count else ""
    )


def positions_fault(position_m: Any, count: int) -> str:
    """Return the error in the positions of burning targets, or ""."""
    if (
        not isinstance(position_m, np.ndarray)
        or position_m.shape != (count, 3)
        or position_m.dtype.kind != "f"
    ):
        got = (
            f"{position_m.dtype} of shape {position_m.shape}"
            if isinstance(position_m, np.ndarray)
            else kind_of(position_m)
        )
        return f"positions as {got} for {count} times; floats of shape ({count}, 3) are required"
    radius_m = np.sqrt(np.square(position_m).sum(axis=1))
    wrong = np.flatnonzero(
        ~((radius_m >= _LEAST_TARGET_RADIUS_M) & (radius_m <= _MOST_TARGET_RADIUS_M))
    )
    if wrong.size:
        where = f"{radius_m[wrong[0]]:g} m from the Earth's centre"
        return f"a position {where} during a burn; positions are in ECEF, in metres"
    return ""


@define
class BuildProblems:
    """The problems of several components, each once, with their paths in the scene."""

    found: dict[Problem, None] = field(factory=dict)

    @contextmanager
    def of(self, path: str) -> Iterator[None]:
        """Collect the problems of the component at a path; it may name its settings relative to its
        own block.
        """
        try:
            yield
        except SceneError as error:
            self.found |= dict.fromkeys(_under(path, problem) for problem in error.problems)

    def require_none(self) -> None:
        """Raise `SceneError` with all problems, if any."""
        if self.found:
            raise SceneError(self.found)


def _under(path: str, problem: Problem) -> Problem:
    if problem.path.startswith(path):
        return problem
    return evolve(problem, path=f"{path}.{problem.path}" if problem.path else path)


def built(host: Host, choice: Choice, context: Any, config: Any = None) -> Any:
    """Build the component of a scene's choice, from the choice's configuration or another.

    Raises `ModelError` that names the component and its owner if it fails.
    """
    component = host.component(choice.hook, choice.name, choice.path)
    settings = choice.config if config is None else config
    hint = check_hint(choice.name)
    return blamed_call(
        lambda: owner_text(host, choice), hint, "build", lambda: component.build(settings, context)
    )


def tracker_fault(tracker: Any) -> str:
    """Return the missing or invalid attribute of a tracker, or ""; one that never steps needs no
    methods.
    """
    if getattr(tracker, "cadence_s", 0.0) is None:
        return ""
    kind = kind_of(tracker)
    missing = [
        method
        for method in _TRACKER_METHODS
        if not callable(getattr(tracker, method.partition("(")[0], None))
    ]
    if missing:
        return f"build made {kind} without {' and '.join(missing)}"
    if not hasattr(tracker, "cadence_s"):
        return f"build made {kind} without cadence_s, the seconds between two ticks"
    cadence_s = tracker.cadence_s
    try:
        is_time = cadence_s is None or 0.0 < cadence_s < float("inf")
    except TypeError:
        is_time = False
    return (
        ""
        if is_time
        else f"cadence_s is {cadence_s!r}, neither a positive number of seconds nor None"
    )
