"""A row per launch: what is known of the launches of every run, and what its metrics add.

Times count from ignition, in s. A value is inf where a launch has none, such as the time of a
detection that never came, and nan where it does not apply.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from opir_core import Plan, Run
from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.planning import Looks, look_times_s
from opir_core.plugin import Metric

#: The unit of a column of names.
NAMES = "name"

#: Columns of every study, with their units.
BASE_UNITS: Mapping[str, str] = {
    "looked_s": "s",
    "detected_s": "s",
    "reported_s": "s",
    "reported_type": NAMES,
}

#: Columns that describe a launch: the same in all runs of a design.
FACTS = ("launch", "class", "site")


def launch_units(metrics: Sequence[Metric]) -> Mapping[str, str]:
    """Return the columns of launches with their units: those of every study, and of metrics."""
    units = dict(BASE_UNITS)
    for metric in metrics:
        units |= getattr(metric, "launch_units", {})
    return units


def launch_facts(plan: Plan) -> tuple[tuple[str, str, str], ...]:
    """Return id, class and site of each launch of a plan; a site is its launch point in degrees."""
    count = len(plan.scene.targets)
    truths = plan.targets.truth()[:count]
    sites = [_site(truth.get("launch") or {}) for truth in truths]
    names = zip(plan.targets.ids[:count], plan.targets.class_names[:count], sites, strict=True)
    return tuple(names)


def _site(place: Mapping[str, float]) -> str:
    if "lat_deg" not in place:
        return "unknown"
    latitude, longitude = (round(place[name], 2) for name in ("lat_deg", "lon_deg"))
    return (
        f"{abs(latitude):g}{'N' if latitude >= 0.0 else 'S'}"
        f" {abs(longitude):g}{'E' if longitude >= 0.0 else 'W'}"
    )


def base_columns(run: Run) -> Mapping[str, Sequence[Any]]:
    """Return the columns of `BASE_UNITS`, one value per launch."""
    targets = run.summary["targets"][: len(run.plan.scene.targets)]
    return {
        "looked_s": first_look_s(run.plan).tolist(),
        "detected_s": _or_never([row["latency_s"] for row in targets]),
        "reported_s": _or_never([row["end_to_end_latency_s"] for row in targets]),
        "reported_type": [row["reported_type"] or "none" for row in targets],
    }


def _or_never(values: Sequence[float | None]) -> list[float]:
    return [np.inf if value is None else float(value) for value in values]


def first_look_s(plan: Plan) -> FloatArray:
    """Return the time from ignition to the first look at each launch (n,), s; inf without one.

    A look is a scan of a sensor that has the launch in view, whether it detects it or not.
    """
    launches = len(plan.scene.targets)
    pairs = plan.pairs
    earliest_s = np.full(launches, np.inf)
    looks = Looks.between(pairs, 0, plan.end_ns)
    selected = np.flatnonzero(_is_first_of_pair(looks.pair) | pairs.is_checked[looks.pair])
    selected = selected[pairs.target[looks.pair[selected]] < launches]
    pair = looks.pair[selected]
    scan = looks.scan[selected]
    is_visible = plan.look_geometry().visible(pair, scan) if len(pair) else np.zeros(0, np.bool_)
    pair = pair[is_visible]
    time_s = look_times_s(pairs, pair, scan[is_visible])
    np.minimum.at(earliest_s, pairs.target[pair], time_s)
    return earliest_s - plan.targets.ignition_s[:launches]


def _is_first_of_pair(pair: IntArray) -> BoolArray:
    return np.append(True, np.diff(pair) != 0) if len(pair) else np.zeros(0, np.bool_)


def launch_columns(run: Run, metrics: Sequence[Metric]) -> tuple[tuple[Any, ...], ...]:
    """Return the columns of a run's launches in the order of `launch_units`.

    Raises `ValueError` for a metric that gives other columns than it names, or not one value per
    launch.
    """
    columns: dict[str, Sequence[Any]] = dict(base_columns(run))
    contributors: list[Any] = [metric for metric in metrics if hasattr(metric, "launch_units")]
    for metric in contributors:
        units = metric.launch_units
        added = {name: list(values) for name, values in metric.launches(run).items()}
        if added.keys() != units.keys():
            words = f"the metric gives {', '.join(added)} of launches, where it names"
            raise ValueError(f"{words} {', '.join(units)}")
        columns |= added
    count = len(run.plan.scene.targets)
    for name, values in columns.items():
        if len(values) != count:
            raise ValueError(f"the column {name} has {len(values)} values for {count} launches")
    return tuple(tuple(columns[name]) for name in launch_units(metrics))
