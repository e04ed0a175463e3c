"""The trackers on one scene: the figures of `opir compare`, as a CSV file, a plot and a page."""

import contextlib
import io
import json
import os
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import yaml
from pages import COLOURS, markdown_table, options_of, publish, shown, svg_plot

from opir_core.cli.main import main as opir

SCENE = "examples/pacific_test_range.yaml"
SENSORS = "sensors=[{constellation: SBIRS-GEO}]"
#: What is written after `--tracker`, and its name on the page.
TRACKERS = {
    "kepler-arc": "kepler-arc",
    "imm": "imm",
}
FIGURES: dict[str, dict[str, list[Any]]] = yaml.safe_load(
    Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8")
)

PAGE = """# Comparison of trackers on one scene

Which tracker is how accurate, how consistent and how fast?

* `imm` is the more accurate from {ahead} s after ignition on, its velocity always, and consistent
  to slightly conservative. Until then `kepler-arc` has the better position: where one sensor sees
  a target, it assumes an altitude.
* `kepler-arc`, the paper's tracker, has errors that grow during the burn, and covariances that do
  not show them.

![RMSE, error over the bound, and NEES, by time since ignition](comparing-trackers.svg)

{table}

Intervals are 95 %. An ICBM, an IRBM and an SRBM (`{scene}`), observed by the default fleet of
SBIRS-GEO, in {runs} runs. All trackers get the same detections and data association, so only their
estimates differ ({tracked} of the launches tracked, {tracks} tracks per launch, {false} false
tracks per run, purity {purity}). Every figure in 20 s bins, with the confusion of types:
[comparing-trackers.csv](comparing-trackers.csv); [score tracks](../how-to/score-tracks.md) defines
them. The comparison again:

```
opir compare {scene} --set "{sensors}" \\
    {words} --runs {runs}
```

* **kepler-arc** has the states of imm. Its impact is that of the Keplerian arc once a target no
  longer burns: none during the boost.
* **imm** has the specific force in its state and does not lag. It assumes a boost about along the
  velocity, so it may be below the bound *with the thrust unknown*, which allows any force. Its
  impact regions include what the target may still burn: they are large in the burn, and shrink at
  burnout.
"""

#: Rows of the short table: the quantity and the start of its time bin, "" for all launches.
LINES = {
    "position RMSE, 100–120 s, m": ("position_rmse_m", 100),
    "velocity RMSE, 100–120 s, m/s": ("velocity_rmse_m_s", 100),
    "NEES / 6, 100–120 s (1 is consistent)": ("nees_over_6", 100),
    "last launch point, RMSE, m": ("launch_rmse_m", ""),
    "last impact point, RMSE, km": ("impact_rmse_km", ""),
    "impacts in the 95 % ellipse, %": ("impact_in_95_ellipse_percent", ""),
    "types correct": ("type_correct_share", ""),
}
#: Panels of the plot, and their axes.
PANELS = {
    "position_rmse_m": "position RMSE, m",
    "velocity_rmse_m_s": "velocity RMSE, m/s",
    "position_rmse_over_bound_thrust_unknown": "position RMSE / bound,\nthrust unknown",
    "nees_over_6": "NEES / 6 (1 is consistent)",
}


def compared(runs, duration_s):
    """Return the figures of `opir compare --json` by tracker."""
    words = ["compare", SCENE, "--set", SENSORS, "--set", f"duration_s={duration_s:g}"]
    words += ["--runs", str(runs), "--json"]
    for tracker in TRACKERS:
        words += ["--tracker", tracker]
    with contextlib.redirect_stdout(io.StringIO()) as output:
        opir(words)
    return json.loads(output.getvalue())["trackers"]


def cell(value, scale, digits):
    """Return a figure as the CSV file has it, nothing where it is unknown."""
    return "" if value is None else f"{scale * value:.{digits}f}"


def plain(name, value, samples=""):
    """Return a figure without an interval."""
    blank = {"low": "", "high": "", "interval": ""}
    return {"quantity": name, "samples": samples, "value": value, **blank}


def figure(estimate, name, scale, digits, samples=""):
    """Return a figure with its 95 % interval."""
    low, high = (cell(edge, scale, digits) for edge in estimate["interval_95"])
    interval = {"low": low, "high": high, "interval": "95 % confidence" if low else ""}
    return {**plain(name, cell(estimate["value"], scale, digits), samples), **interval}


def launch_rows(card):
    """Yield the figures of all launches."""
    yield plain("runs", card["runs"])
    for key, settings in FIGURES["all launches"].items():
        yield figure(card[key], *settings)
    gospa = card["gospa"]
    yield figure(gospa["a_target_m"], "gospa_per_target_m", 1.0, 0)
    names = ("localisation", "missed", "false")
    shares = {name: gospa[f"{name}_a_target"]["value"] for name in names}
    for name, share in shares.items():
        yield plain(f"gospa_{name}_percent", cell(share / sum(shares.values()), 100.0, 0))
    for kind, row in card["type_confusion"].items():
        for reported, count in row.items():
            yield plain(f"{kind}_reported_as_{reported}_count", count)
    yield from point_rows(card, card["stereo"])


def point_rows(card, stereo):
    """Yield the figures of launch and impact points, of hypotheses, and of recognised launches."""
    for key in ("targets", "launches_reported", "impacts_reported"):
        yield plain(key, stereo[key])
    for key, settings in FIGURES["points"].items():
        yield figure(stereo[key], *settings)
    phase = stereo["impact_by_phase"][-1]
    yield figure(phase["energy_m"], "impact_energy_score_km", 1e-3, 1)
    age = card["hypotheses"]["by_age"][-1]
    for key, name in (("log_score", "hypothesis_log_score"), ("brier", "hypothesis_brier_score")):
        yield figure(age[key], name, 1.0, 3, age["tracks"])
    for key in ("launches_recognised", "false_launches_an_hour"):
        yield figure(card["recognition"][key], key, 1.0, 3)
    for point in ("launch", "impact"):
        for share in stereo[f"{point}_containment"]:
            name = f"{point}_in_{100.0 * share['nominal']:.0f}_ellipse_percent"
            yield figure(share, name, 100.0, 0)


def bin_rows(time_bin):
    """Yield the figures of one bin of time since ignition."""
    for key, settings in FIGURES["time bin"].items():
        yield figure(time_bin[key], *settings, time_bin["samples"])
    for key, name in (("nees", "nees_over_6"), ("nis", "nis_over_2")):
        figures = time_bin[key]
        low, high = (cell(edge, 1.0, 2) for edge in figures["band_99"])
        mean = plain(name, cell(figures["mean"], 1.0, 2), figures["samples"])
        yield {**mean, "low": low, "high": high, "interval": "99 % band"}
        yield plain(f"{name}_ks_p", cell(figures["distribution_p"], 1.0, 3), figures["samples"])


def rows_of(runs, duration_s):
    """Yield the rows of the CSV file."""
    for tracker, card in compared(runs, duration_s).items():
        for row in launch_rows(card):
            yield {"tracker": tracker, "from_s": "", "to_s": "", **row}
        for time_bin in card["stereo"]["by_time"]:
            start, end = (f"{edge:g}" for edge in time_bin["since_ignition_s"])
            for row in bin_rows(time_bin):
                yield {"tracker": tracker, "from_s": start, "to_s": end, **row}


def page(table):
    """Return the page."""
    names = [name for name in TRACKERS if name in table.names("tracker")]

    def value(tracker, quantity):
        return table.row(tracker=tracker, quantity=quantity, from_s="")["value"]

    lines = []
    for label, (quantity, start) in LINES.items():
        rows = table.where(quantity=quantity, from_s=start)
        cells = [cell_of(rows.row(tracker=name)) for name in names if rows.where(tracker=name)]
        lines.append((label, *cells))
    times = [value(name, "time_per_detection_us") for name in names]
    lines.append(
        ("processor time over that of imm", *(f"{time / times[-1]:.1f}" for time in times))
    )
    quoted = [f'"{name}"' if " " in name else name for name in TRACKERS]
    return PAGE.format(
        table=markdown_table(("", *(TRACKERS[name] for name in names)), lines),
        scene=SCENE,
        sensors=SENSORS,
        words=" ".join(f"--tracker {name}" for name in quoted),
        runs=value(names[0], "runs"),
        ahead=ahead_s(table.where(quantity="position_rmse_m")),
        tracked=value(names[0], "launches_tracked_share"),
        tracks=value(names[0], "tracks_per_launch"),
        false=value(names[0], "false_tracks_per_run"),
        purity=value(names[0], "purity_share"),
    )


def ahead_s(errors):
    """Return the start of the bin from which on imm has the least position RMSE of all trackers."""
    starts = errors.names("from_s")
    lowest = [
        min(errors.where(from_s=start), key=lambda row: row["value"] or float("inf"))["tracker"]
        for start in starts
    ]
    behind = [number for number, name in enumerate(lowest) if name != "imm"]
    return [*starts, "–"][max(behind, default=-1) + 1]


def cell_of(row):
    """Return a cell of the short table, shares in an ellipse with their interval."""
    value = shown(row["value"], "g")
    has_interval = "ellipse" in row["quantity"] and row["low"] != ""
    return f"{value} [{row['low']}, {row['high']}]" if has_interval else value


def draw(path, table):
    """Draw figures by time since ignition, with their 95 % intervals."""
    with svg_plot(path, 2, 2, figsize=(10.0, 7.0), sharex=True) as (_, axes):
        for panel, (quantity, label) in zip(axes.flat, PANELS.items(), strict=True):
            for colour, (tracker, name) in zip(COLOURS, TRACKERS.items(), strict=False):
                rows = table.where(tracker=tracker, quantity=quantity)
                middle = [0.5 * (row["from_s"] + row["to_s"]) for row in rows]
                panel.plot(middle, rows.column("value"), color=colour, label=name)
                if all(row["interval"].endswith("confidence") for row in rows):
                    edges = (rows.column("low"), rows.column("high"))
                    panel.fill_between(middle, *edges, color=colour, alpha=0.2, linewidth=0.0)
            panel.set(yscale="log", ylabel=label, xlabel="time since ignition, s")


def main():
    """Measure and write."""
    options = options_of(__doc__, runs=5, duration=300.0)
    rows = rows_of(options.runs, options.duration)
    publish(options, page, draw, **{"comparing-trackers": rows})


if __name__ == "__main__":
    main()
