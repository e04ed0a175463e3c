"""Complexity: processor time and peak memory of a whole process against targets, sensors, duration
and scan rate.

    python benchmarks/complexity.py [--decades 3] [--write docs/benchmarks] [--from-csv
    docs/benchmarks]

One quantity grows over three decades, the others stay. Each point is a process of its own that runs
a scene with a constant P_d and encodes its events, without a file. Looks that do not detect cost as
others where geometry is needed. Exponents are those of a power law above a constant start, a + b
n^k, fitted to the logarithms of processor times, and of memory, by least squares; a is what the
smallest point takes.
"""

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from result_files import BLUE, ORANGE, number, read_csv, svg_plot, write_csv

#: The scene that stays: with all of these a run is short, so that the largest points take about a
#: minute.
BASE = {"targets": 10, "sensors": 2, "duration_s": 60.0, "rate_hz": 1.0}
#: The first value of each quantity; the last is 10 to the number of decades times that.
FIRST = {"targets": 10, "sensors": 2, "duration_s": 60.0, "rate_hz": 1.0}
UNITS = {
    "targets": "targets",
    "sensors": "sensors",
    "duration_s": "duration, s",
    "rate_hz": "looks per second",
}
#: Points a decade.
POINTS = 2

PAGE = """# Complexity

How do time and memory grow with targets, sensors, duration and scan rate? {answer}

![Processor time and peak memory of a whole process against each quantity](complexity.svg)

Exponents k of a + b nᵏ: 1 is linear; 0 is memory that grows less than {flat} over all decades. One quantity
varies, the others are {base}; every minute has as many launches
anew. P_d 0.5, no tracker; events are encoded as JSON and dropped. Processor time is that of the whole process, start-up
included. All points: [complexity.csv](complexity.csv).
"""
#: Growth of memory over all decades that counts as none.
FLAT = 1.25


def scene(targets: int, sensors: int, duration_s: float, rate_hz: float) -> dict[str, Any]:
    """Return a scene as plain values: equally many launches every minute, so that looks grow with
    the duration.
    """
    rng = np.random.default_rng(7)
    places = rng.uniform(-20.0, 20.0, (targets, 2))
    return {
        "scene": "complexity",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": duration_s,
        "seed": 1,
        "sensors": [
            {
                "model": "SBIRS-GEO",
                "id": f"S{n:05d}",
                "orbital_slot_deg": -30.0 + 60.0 * n / sensors,
                "scan_period_ms": round(1e3 / rate_hz, 6),
                "detection_probability": {"ICBM": 0.5},
            }
            for n in range(sensors)
        ],
        "targets": [
            {
                "id": f"T{n:05d}",
                "type": "ICBM",
                "launch": {"lat_deg": float(lat), "lon_deg": float(lon), "time_s": float(at)},
                "aim": {"lat_deg": float(lat) - 60.0, "lon_deg": float(lon) + 30.0},
            }
            for n, ((lat, lon), at) in enumerate(
                (place, at) for at in np.arange(0.0, duration_s, 60.0) for place in places
            )
        ],
        "outputs": [],
    }


def child(values: Mapping[str, float]) -> None:
    """Run a scene, encode its events, and print the looks and events."""
    import opir_core as opir

    opir_scene = opir.scene_from_mapping(
        scene(
            int(values["targets"]), int(values["sensors"]), values["duration_s"], values["rate_hz"]
        )
    )
    from opir_core.interfaces.contexts import EncoderContext
    from opir_core.output.events.encoder_input import window_blocks
    from opir_core.output.events.forge import ForgeEncoder
    from opir_core.output.events.rendering import chosen_renderer
    from opir_core.planning.plan import compile_plan
    from opir_core.simulation.run import plan_windows

    plan = compile_plan(opir_scene)
    encoder = ForgeEncoder(
        EncoderContext(sensors=plan.sensors, epoch_us=0, render=chosen_renderer(plan.host)[1])
    )
    looks = 0
    events = 0
    for window in plan_windows(plan):
        looks = looks + window.looks
        events = events + len(window.detections)
        for block in window_blocks(window):
            encoder.encode(block)
    print(json.dumps({"looks": looks, "events": events}))


def measured(values: Mapping[str, float]) -> dict[str, float]:
    """Return processor time, s, and peak memory, MiB, of a process, and its looks and events."""
    command = [sys.executable, __file__, "--child", json.dumps(values)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE)
    text = process.stdout.read() if process.stdout else b""
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{values} ended with exit code {process.returncode}")
    return {
        "processor_s": used.ru_utime + used.ru_stime,
        "peak_mib": used.ru_maxrss / 1024,
        **json.loads(text),
    }


def rows(decades: float) -> Iterator[dict[str, str]]:
    """Yield the points of every quantity."""
    for quantity, first in FIRST.items():
        for value in first * 10.0 ** np.linspace(0.0, decades, round(POINTS * decades) + 1):
            point = {**BASE, quantity: round(value) if isinstance(first, int) else float(value)}
            found = measured(point)
            row = {"quantity": quantity, "value": f"{point[quantity]:.6g}"}
            row |= {"looks": str(found["looks"]), "events": str(found["events"])}
            row |= {
                "processor_s": f"{found['processor_s']:.3f}",
                "peak_mib": f"{found['peak_mib']:.1f}",
            }
            print(",".join(row.values()), flush=True)
            yield row


def exponent(value: np.ndarray, cost: np.ndarray) -> float:
    """Return k of a + b n^k, with a the smallest of the costs that leaves the rest a power law, by
    least squares.
    """
    if cost.max() < FLAT * cost.min():
        return 0.0
    best = (np.inf, 0.0)
    for start in np.linspace(0.0, 0.999, 200) * cost.min():
        slope, offset = np.polyfit(np.log(value), np.log(cost - start), 1)
        off = start + np.exp(offset) * value**slope
        best = min(best, (float(np.sum(np.log(off / cost) ** 2)), float(slope)))
    return best[1]


def exponents(table: Sequence[Mapping[str, str]]) -> dict[str, tuple[float, float]]:
    """Return the exponents of time and memory by quantity."""
    found = {}
    for quantity in dict.fromkeys(row["quantity"] for row in table):
        mine = [row for row in table if row["quantity"] == quantity]
        value, *costs = (
            np.array([number(row[name]) for row in mine])
            for name in ("value", "processor_s", "peak_mib")
        )
        found[quantity] = exponent(value, costs[0]), exponent(value, costs[1])
    return found


def write_page(folder: Path) -> None:
    """Write page and plot beside the CSV file in a folder."""
    table = read_csv(folder / "complexity.csv")
    found = exponents(table)
    parts = []
    for quantity, (time, memory) in found.items():
        low, *_, high = (row for row in table if row["quantity"] == quantity)
        look_us = 1e6 * number(high["processor_s"]) / number(high["looks"])
        parts.append(
            f"{UNITS[quantity].partition(',')[0]}, {low['value']} to {high['value']}: {time:.2f}"
            f" and {memory:.2f}"
            f" ({look_us:.1f} µs a look at the end)"
        )
    page = PAGE.format(
        answer=f"The exponents of processor time and peak memory are, of {'; '.join(parts)}.",
        flat=f"{FLAT:g} times",
        base=f"{BASE['targets']} targets, {BASE['sensors']} sensors, {BASE['duration_s']:g} s, a"
        f" look per second",
    )
    (folder / "complexity.md").write_text(page, encoding="utf-8")
    plot(table, found, folder / "complexity.svg")


def plot(
    table: Sequence[Mapping[str, str]], found: Mapping[str, tuple[float, float]], path: Path
) -> None:
    """Draw time and memory against each quantity."""
    with svg_plot(path, 2, len(found), figsize=(12.0, 5.5), sharey="row") as (_, axes):
        for column, (quantity, both) in enumerate(found.items()):
            mine = [row for row in table if row["quantity"] == quantity]
            for row, (name, colour) in enumerate((("processor_s", BLUE), ("peak_mib", ORANGE))):
                place = axes[row, column]
                value, cost = ([number(each[key]) for each in mine] for key in ("value", name))
                place.loglog(value, cost, "o-", color=colour, label=f"exponent {both[row]:.2f}")
                place.legend(frameon=False, loc="upper left")
                place.grid(alpha=0.3)
            axes[1, column].set_xlabel(UNITS[quantity])
        axes[0, 0].set_ylabel("processor time, s")
        axes[1, 0].set_ylabel("peak memory, MiB")


def main() -> None:
    """Measure, or draw page and plot again from the CSV file in a folder."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--decades", type=float, default=3.0)
    parser.add_argument("--write", type=Path, metavar="FOLDER")
    parser.add_argument("--from-csv", type=Path, metavar="FOLDER")
    parser.add_argument("--child", type=json.loads, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child:
        child(given.child)
        return
    if given.from_csv:
        write_page(given.from_csv)
        return
    table = list(rows(given.decades))
    for quantity, both in exponents(table).items():
        print(f"{quantity}: time {both[0]:.2f}, memory {both[1]:.2f}")
    if given.write:
        write_csv(given.write / "complexity.csv", table)
        write_page(given.write)


if __name__ == "__main__":
    main()
