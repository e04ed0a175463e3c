"""`opir validate` checks a scene, `opir explain` shows what it computes, what it skips, and why."""

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from operator import itemgetter
from typing import Any, NamedTuple

from opir_core.cli.scene_arguments import add_scene_arguments, check_of, plan_of, scene_of
from opir_core.cli.terminal import grouped, table
from opir_core.host.host import Host
from opir_core.host.registry import warn
from opir_core.planning.plan import Plan
from opir_core.scene.scene import BY_REPORT
from opir_core.simulation.explanation import explained
from opir_core.simulation.plan_checks import expectation_text, plan_warnings


def validate_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the scene and its overrides."""
    add_scene_arguments(parser)


def validate(arguments: argparse.Namespace) -> int:
    """Read and check the scene; errors are raised."""
    host = Host.discover()
    checked = check_of(arguments, scene_of(arguments, host), host)
    for warning in plan_warnings(checked):
        warn(warning)
    size = f"{len(checked.sensors)} sensors, {len(checked.targets.ids)} targets"
    lines = [f"{arguments.scene}: valid ({size})", *checked.scene.automatic]
    sys.stdout.write("\n".join(lines) + "\n")
    return 0


def explain_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the scene, its overrides and the output format."""
    add_scene_arguments(parser)
    parser.add_argument("--json", action="store_true", help="print JSON")


def explain(arguments: argparse.Namespace) -> int:
    """Compile the scene's plan and print it."""
    explanation = explained(_plan(arguments))
    sys.stdout.write(
        (json.dumps(explanation, indent=2) if arguments.json else _as_text(explanation)) + "\n"
    )
    return 0


def _plan(arguments: argparse.Namespace) -> Plan:
    host = Host.discover()
    return plan_of(arguments, scene_of(arguments, host), host)


class _Listing(NamedTuple):
    """A table of an explanation: its heads, the cells of a row, and the columns of numbers."""

    heads: Sequence[str]
    cells: Callable[[Mapping[str, Any]], Sequence[str]]
    numbers: Sequence[int] = ()


def _as_text(plan: Mapping[str, Any]) -> str:
    tables = (_table_text(key, plan[key]) for key in _TABLES)
    return "\n\n".join(
        [
            _head(plan),
            *filter(None, tables),
            *_report_order(**plan["tracking"]),
            *_lines("the tracker begins with", plan["sensors_assumed"]),
            *_hypothesis_table(plan["hypotheses"]),
            *map(expectation_text, plan["expected_launches"]),
            *_lines("sensors fail", plan["faults"]),
            *_lines("sensors that see only where they are pointed", plan["directed"]),
            *_lines("modes that a command may name", plan["modes"]),
            *(
                f"{name} knows the true types of targets: its reports are no test of discrimination"
                for name in plan["truth_users"]
            ),
            "\n".join(f"not computed: {line}" for line in plan["not_computed"]),
            *(f"warning: {line}" for line in plan["warnings"]),
        ]
    )


def _table_text(key: str, rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the table of a list of an explanation; "" if there is nothing to say."""
    heads, cells, numbers = _TABLES[key]
    has_rows = any(row["mean_s"] for row in rows) if key == "reporting" else rows
    is_shown = has_rows or key in ("components", "pairs")
    return table(heads, list(map(cells, rows)), numbers=numbers) if is_shown else ""


def _head(plan: Mapping[str, Any]) -> str:
    size = f"{grouped(plan['looks'])} looks of {len(plan['pairs'])} pairs"
    return "\n".join(
        [f"{plan['scene']}: {size}; forces {', '.join(plan['forces'])}", *plan["automatic"]]
    )


def _report_order(order: str, lag_s: float | None) -> list[str]:
    if order != BY_REPORT:
        return []
    return [f"tracking in the order of report, {lag_s:.3f} s after the ticks"]


def _lines(head: str, lines: Sequence[str]) -> list[str]:
    """Return a paragraph of a head and lines; nothing without lines."""
    return ["\n".join([head, *lines])] if lines else []


def _hypothesis_table(groups: Sequence[Mapping[str, Any]]) -> list[str]:
    headings = {
        "by_motion": "by its motion, to the tracker",
        "by_light": "by its light, to the classifier",
    }
    keys = [key for key in headings if any(row[key] for row in groups)]
    rows = [(", ".join(row["hypotheses"]), *(row[key] for key in keys)) for row in groups]
    return [table(("it may be", *map(headings.__getitem__, keys)), rows)] if rows else []


def _outage_cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    start = _compass(row["azimuth_at_start_deg"])
    stop = _compass(row["azimuth_at_stop_deg"])
    return (
        row["sensor_id"],
        f"{row['start_s']:.1f}",
        f"{row['stop_s']:.1f}",
        start if start == stop else f"{start} to {stop}",
        f"{row['share_of_field']:.1%}",
    )


def _eclipse_cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    times = (row[name] for name in ("start_s", "umbra_start_s", "umbra_stop_s", "stop_s"))
    return (row["sensor_id"], *("-" if time_s is None else f"{time_s:.1f}" for time_s in times))


def _focal_plane_cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    least = row["least_noise_over_nei"]
    largest = row["largest_noise_over_nei"]
    return (
        row["sensor_id"],
        row["band"],
        f"{row['nei_w_m2']:.2g}",
        "-" if largest is None else f"{least:.3g} to {largest:.3g}",
        f"{row['share_in_pixel']:.0%}",
        f"{row['saturation_w_m2']:.2g}",
    )


def _compass(azimuth_deg: float) -> str:
    """Return the nearest of eight points of the compass."""
    points = (
        "north",
        "north-east",
        "east",
        "south-east",
        "south",
        "south-west",
        "west",
        "north-west",
    )
    return points[round(azimuth_deg / 45.0) % len(points)]


def _reporting_cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    stages = (f"{stage['name']} {_spread(stage)}" for stage in row["stages"] if stage["mean_s"])
    return row["sensor_id"], f"{row['mean_s']:g}", f"{row['sigma_s']:.3g}", ", ".join(stages) or "-"


def _link_cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    path = row["path"]
    return (
        row["sensor_id"],
        "no contact" if path is None else " > ".join(path),
        f"{row['share']:.1%}",
        f"{row['longest_s']:.1f}",
        "waits" if path is None else f"{row['delay_s']:.3f}",
    )


def _rate_cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    scene = ", ".join(f"{grouped(count)} {kind}" for kind, count in row["scene"].items())
    expected = f"{row['in_duration']:.2g}"
    return row["what"], f"{row['per_day']:g}", expected, scene or "-", row["source"]


def _spread(stage: Mapping[str, Any]) -> str:
    """Return `35 ± 8.66`, or `35` for a constant latency."""
    return (
        f"{stage['mean_s']:g} ± {stage['sigma_s']:.3g}"
        if stage["sigma_s"]
        else f"{stage['mean_s']:g}"
    )


def _pair_cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    probability = row["probability"]
    return (
        row["sensor_id"],
        row["target_id"],
        grouped(row["looks"]),
        f"{row['first_look_s']:.3f}",
        f"{row['last_look_s']:.3f}",
        row["visible"],
        "varies" if probability is None else f"{probability:g}",
    )


def _component_cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    return row["kind"], row["name"], f"{row['distribution']} {row['version']}"


def _dark_cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    return row["target_id"], f"{row['start_s']:.3f}", f"{row['stop_s']:.3f}"


def _noise_cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    return row["sensor_id"], f"{row['per_scan']:.3g}", f"{row['per_day']:.3g}"


#: The tables of an explanation, in their order, by the keys of their rows.
_TABLES = {
    "components": _Listing(("kind", "name", "from"), _component_cells),
    "pairs": _Listing(
        ("sensor", "target", "looks", "from s", "to s", "visible", "P_d"), _pair_cells, (2, 3, 4, 6)
    ),
    "dark": _Listing(("target", "dark from s", "to s"), _dark_cells, (1, 2)),
    "skipped": _Listing(
        ("sensor", "target", "skipped because"), itemgetter("sensor_id", "target_id", "reason")
    ),
    "outages": _Listing(
        ("sensor", "Sun too close from s", "to s", "towards", "of its field"),
        _outage_cells,
        (1, 2, 4),
    ),
    "eclipses": _Listing(
        ("sensor", "eclipsed from s", "umbra from s", "to s", "eclipsed to s"),
        _eclipse_cells,
        (1, 2, 3, 4),
    ),
    "noise": _Listing(
        ("sensor", "false alarms of noise and clutter per scan", "per day"), _noise_cells, (1, 2)
    ),
    "focal_planes": _Listing(
        ("sensor", "band", "NEI W/m2", "noise over NEI", "in one pixel", "saturation W/m2"),
        _focal_plane_cells,
        (2, 3, 4, 5),
    ),
    "links": _Listing(
        ("sensor", "reports go by", "of the time", "longest s", "arrive after s"),
        _link_cells,
        (2, 3, 4),
    ),
    "rates": _Listing(
        ("the tracker assumes in view", "per day", "in this time", "the scene has", "source"),
        _rate_cells,
        (1, 2),
    ),
    "reporting": _Listing(("sensor", "reports after s", "σ s", "stages"), _reporting_cells),
}
