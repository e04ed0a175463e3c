"""The trackers on one scene: what `opir compare` prints, as a CSV file, a plot and a page.

python benchmarks/tracker_comparison.py [--runs 5] [--duration 300] [--write docs/explanation]
python benchmarks/tracker_comparison.py --from-csv docs/explanation/comparing-trackers.csv
"""

import argparse
import contextlib
import io
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from result_files import write_csv
from tracker_comparison_page import SCENE, SENSORS, TRACKERS, write_page

from opir_core.cli.main import main as opir

#: Keys of `opir compare --json`: of all launches, of a time bin, of launches and impacts; the
#: column, scale and digits.
WHOLE = {
    "launches_tracked": ("launches_tracked_share", 1.0, 3),
    "tracks_a_launch": ("tracks_per_launch", 1.0, 2),
    "false_tracks_a_run": ("false_tracks_per_run", 1.0, 2),
    "purity": ("purity_share", 1.0, 4),
    "completeness": ("completeness_share", 1.0, 3),
    "first_track_after_s": ("first_track_after_s", 1.0, 2),
    "type_right": ("type_correct_share", 1.0, 3),
    "tracking_us_a_detection": ("time_per_detection_us", 1.0, 1),
    "tracking_us_a_track_update": ("time_per_track_update_us", 1.0, 0),
}
BINNED = {
    "position_m": ("position_rmse_m", 1.0, 0),
    "position_over_bound": ("position_rmse_over_bound_thrust_known", 1.0, 2),
    "position_over_free_bound": ("position_rmse_over_bound_thrust_unknown", 1.0, 2),
    "velocity_m_s": ("velocity_rmse_m_s", 1.0, 1),
    "velocity_over_bound": ("velocity_rmse_over_bound_thrust_known", 1.0, 2),
    "velocity_over_free_bound": ("velocity_rmse_over_bound_thrust_unknown", 1.0, 2),
    "position_energy_m": ("position_energy_score_m", 1.0, 0),
    "velocity_energy_m_s": ("velocity_energy_score_m_s", 1.0, 1),
    "impact_m": ("impact_rmse_km", 1e-3, 1),
}
POINTS = {
    "launch_m": ("launch_rmse_m", 1.0, 0),
    "launch_energy_m": ("launch_energy_score_m", 1.0, 0),
    "launch_time_s": ("launch_time_rmse_s", 1.0, 2),
    "impact_m": ("impact_rmse_km", 1e-3, 1),
    "impact_time_s": ("impact_time_rmse_s", 1.0, 2),
}
COUNTS = {
    "targets": "targets",
    "launches_reported": "launches_reported",
    "impacts_reported": "impacts_reported",
}
CONFIDENCE = "95 % confidence"
BAND = "99 % band"


def compared(runs: int, duration_s: float) -> Any:
    """Return the figures of `opir compare --json`."""
    words = [
        "compare",
        SCENE,
        "--set",
        SENSORS,
        "--set",
        f"duration_s={duration_s:g}",
        "--runs",
        str(runs),
        "--json",
    ]
    for tracker in TRACKERS:
        words += ["--tracker", tracker]
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        opir(words)
    return json.loads(printed.getvalue())["trackers"]


def cell(value: float | None, scale: float, digits: int) -> str:
    """Return a figure as the CSV file has it, nothing where it is not known."""
    return "" if value is None else f"{scale * value:.{digits}f}"


def figure(
    found: dict[str, Any], name: str, scale: float, digits: int, samples: int | str = ""
) -> dict[str, str]:
    """Return a figure with its 95 % interval."""
    value, low, high = (
        cell(each, scale, digits) for each in (found["value"], *found["interval_95"])
    )
    kind = CONFIDENCE if low else ""
    return {
        "quantity": name,
        "samples": str(samples),
        "value": value,
        "low": low,
        "high": high,
        "interval": kind,
    }


def plain(name: str, value: str, samples: int | str = "") -> dict[str, str]:
    """Return a figure without an interval."""
    return {
        "quantity": name,
        "samples": str(samples),
        "value": value,
        "low": "",
        "high": "",
        "interval": "",
    }


def whole_rows(card: dict[str, Any]) -> Iterator[dict[str, str]]:
    """Yield the figures of all launches."""
    yield plain("runs", str(card["runs"]))
    for key, (name, scale, digits) in WHOLE.items():
        yield figure(card[key], name, scale, digits)
    gospa = card["gospa"]
    yield figure(gospa["a_target_m"], "gospa_per_target_m", 1.0, 0)
    parts = {
        name: gospa[f"{name}_a_target"]["value"] for name in ("localisation", "missed", "false")
    }
    for name, part in parts.items():
        yield plain(f"gospa_{name}_percent", cell(part / sum(parts.values()), 100.0, 0))
    for true, row in card["type_confusion"].items():
        for reported, count in row.items():
            yield plain(f"{true}_reported_as_{reported}_count", str(count))
    stereo = card["stereo"]
    for key, name in COUNTS.items():
        yield plain(name, str(stereo[key]))
    for key, (name, scale, digits) in POINTS.items():
        yield figure(stereo[key], name, scale, digits)
    yield from proper_rows(card)
    for point in ("launch", "impact"):
        for part in stereo[f"{point}_containment"]:
            yield figure(
                part, f"{point}_in_{100.0 * part['nominal']:.0f}_ellipse_percent", 100.0, 0
            )


def proper_rows(card: dict[str, Any]) -> Iterator[dict[str, str]]:
    """Yield the scores of impacts and hypotheses, and what was recognised as a launch."""
    yield figure(
        card["stereo"]["impact_by_phase"][-1]["energy_m"], "impact_energy_score_km", 1e-3, 1
    )
    last = card["hypotheses"]["by_age"][-1]
    for key, name in (("log_score", "hypothesis_log_score"), ("brier", "hypothesis_brier_score")):
        yield figure(last[key], name, 1.0, 3, last["tracks"])
    for key in ("launches_recognised", "false_launches_an_hour"):
        yield figure(card["recognition"][key], key, 1.0, 3)


def bin_rows(part: dict[str, Any]) -> Iterator[dict[str, str]]:
    """Yield the figures of one bin of time since ignition."""
    for key, (name, scale, digits) in BINNED.items():
        yield figure(part[key], name, scale, digits, part["samples"])
    for key, name in (("nees", "nees_over_6"), ("nis", "nis_over_2")):
        found = part[key]
        low, high = (cell(edge, 1.0, 2) for edge in found["band_99"])
        mean = plain(name, cell(found["mean"], 1.0, 2), found["samples"])
        yield {**mean, "low": low, "high": high, "interval": BAND}
        yield plain(f"{name}_ks_p", cell(found["distribution_p"], 1.0, 3), found["samples"])


def rows_of(cards: dict[str, Any]) -> Iterator[dict[str, str]]:
    """Yield the rows of the CSV file."""
    for tracker, card in cards.items():
        for row in whole_rows(card):
            yield {"tracker": tracker, "from_s": "", "to_s": "", **row}
        for part in card["stereo"]["by_time"]:
            start, end = (f"{edge:g}" for edge in part["since_ignition_s"])
            for row in bin_rows(part):
                yield {"tracker": tracker, "from_s": start, "to_s": end, **row}


def main() -> None:
    """Run the comparison and write the results, or redraw page and plot from a CSV file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--duration", type=float, default=300.0, help="seconds of the scene")
    parser.add_argument("--write", type=Path, help="folder for the CSV file, the page and the plot")
    parser.add_argument(
        "--from-csv", type=Path, help="redraw page and plot beside this file, and run nothing"
    )
    chosen = parser.parse_args()
    if chosen.from_csv:
        write_page(chosen.from_csv)
        return
    rows = list(rows_of(compared(chosen.runs, chosen.duration)))
    for row in rows:
        print(",".join(row.values()))
    if chosen.write:
        write_csv(chosen.write / "comparing-trackers.csv", rows)
        write_page(chosen.write / "comparing-trackers.csv")


if __name__ == "__main__":
    main()
