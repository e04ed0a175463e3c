"""Complexity: processor time and peak memory of a whole process against targets, sensors, duration
and scan rate.

One quantity grows over three decades, the others stay. Each point is a process of its own that runs
a scene with a constant P_d and encodes its events, without a file. Looks that do not detect cost as
others where geometry is needed. Exponents are those of a power law above a constant start, a + b
n^k, fitted to the logarithms of processor times, and of memory, by least squares; a is the cost of
the smallest point.
"""

import json
import os
import subprocess
import sys

import numpy as np
from pages import COLOURS, options_of, publish, svg_plot

#: The scene that stays, and the first value of each quantity, whose last is 10 to the number of
#: decades times that: a run is short, so that the largest points take about a minute.
BASE = {"targets": 10, "sensors": 2, "duration_s": 60.0, "rate_hz": 1.0}
UNITS = {
    "targets": "targets",
    "sensors": "sensors",
    "duration_s": "duration, s",
    "rate_hz": "looks per second",
}
#: Growth of memory over all decades that counts as none.
FLAT = 1.25

PAGE = """# Complexity

How do time and memory grow with targets, sensors, duration and scan rate? {answer}

![Processor time and peak memory of a whole process against each quantity](complexity.svg)

Exponents k of a + b nᵏ: 1 is linear; 0 is memory that grows less than {flat:g} times over all
decades. One quantity varies, the others are {base}; every minute has as many launches anew. P_d
0.5, no tracker; events are encoded as JSON and dropped. Processor time is that of the whole
process, start-up included. All points: [complexity.csv](complexity.csv).
"""


def scene(targets, sensors, duration_s, rate_hz):
    """Return a scene with equally many launches every minute: looks grow with the duration."""
    places = np.random.default_rng(7).uniform(-20.0, 20.0, (targets, 2)).tolist()
    launches = [
        {"lat_deg": lat, "lon_deg": lon, "time_s": minute_s}
        for minute_s in np.arange(0.0, duration_s, 60.0).tolist()
        for lat, lon in places
    ]
    sensor = {
        "model": "SBIRS-GEO",
        "scan_period_ms": round(1e3 / rate_hz, 6),
        "detection_probability": {"ICBM": 0.5},
    }
    return {
        "scene": "complexity",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": duration_s,
        "seed": 1,
        "sensors": [
            {**sensor, "id": f"S{n:05d}", "orbital_slot_deg": -30.0 + 60.0 * n / sensors}
            for n in range(sensors)
        ],
        "targets": [
            {
                "id": f"T{n:05d}",
                "type": "ICBM",
                "launch": launch,
                "aim": {"lat_deg": launch["lat_deg"] - 60.0, "lon_deg": launch["lon_deg"] + 30.0},
            }
            for n, launch in enumerate(launches)
        ],
        "outputs": [],
    }


def child(values):
    """Run a scene, encode its events, and print the looks and events."""
    import opir_core as opir
    from opir_core.interfaces.contexts import EncoderContext
    from opir_core.output.events.encoder_input import window_blocks
    from opir_core.output.events.forge import ForgeEncoder
    from opir_core.output.events.rendering import chosen_renderer

    counts = {"targets": int(values["targets"]), "sensors": int(values["sensors"])}
    plan = opir.compile_plan(opir.scene_from_mapping(scene(**{**values, **counts})))
    render = chosen_renderer(plan.host)[1]
    encoder = ForgeEncoder(EncoderContext(sensors=plan.sensors, epoch_us=0, render=render))
    looks = 0
    events = 0
    for window in opir.plan_windows(plan):
        looks += window.looks
        events += len(window.detections)
        for block in window_blocks(window):
            encoder.encode(block)
    print(json.dumps({"looks": looks, "events": events}))


def process_of(*words):
    """Run this script's child; return its output, processor time, s, and peak memory, MiB."""
    process = subprocess.Popen([sys.executable, sys.argv[0], *words], stdout=subprocess.PIPE)
    text = process.stdout.read() if process.stdout else b""
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{words} ended with exit code {process.returncode}")
    return text.decode(), usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def rows_of(decades, points=2):
    """Yield the points of every quantity, so many a decade."""
    for quantity, first in BASE.items():
        for value in first * 10.0 ** np.linspace(0.0, decades, round(points * decades) + 1):
            point = {**BASE, quantity: type(first)(np.round(value, 6))}
            text, processor_s, peak_mib = process_of("--child", json.dumps(point))
            row = {"quantity": quantity, "value": point[quantity], **json.loads(text)}
            yield {**row, "processor_s": processor_s, "peak_mib": peak_mib}


def exponent(value, cost):
    """Return k of a + b n^k by least squares, with a the best start below the smallest cost."""
    if cost.max() < FLAT * cost.min():
        return 0.0
    best = (np.inf, 0.0)
    for start in np.linspace(0.0, 0.999, 200) * cost.min():
        slope, offset = np.polyfit(np.log(value), np.log(cost - start), 1)
        fitted = start + np.exp(offset) * value**slope
        best = min(best, (float(np.sum(np.log(fitted / cost) ** 2)), float(slope)))
    return best[1]


def exponent_of(points, cost):
    """Return the exponent of a cost, `processor_s` or `peak_mib`, of a quantity's points."""
    return exponent(np.array(points.column("value")), np.array(points.column(cost)))


def page(table):
    """Return the page."""
    sentences = []
    for quantity in table.names("quantity"):
        points = table.where(quantity=quantity)
        look_us = 1e6 * points[-1]["processor_s"] / points[-1]["looks"]
        span = f"{points[0]['value']:g} to {points[-1]['value']:g}"
        time = exponent_of(points, "processor_s")
        memory = exponent_of(points, "peak_mib")
        name = UNITS[quantity].partition(",")[0]
        sentences.append(
            f"{name}, {span}: {time:.2f} and {memory:.2f} ({look_us:.1f} µs a look at the end)"
        )
    return PAGE.format(
        answer=f"The exponents of processor time and peak memory are, of {'; '.join(sentences)}.",
        flat=FLAT,
        base=f"{BASE['targets']} targets, {BASE['sensors']} sensors, {BASE['duration_s']:g} s, a"
        " look per second",
    )


def draw(path, table):
    """Draw time and memory against each quantity."""
    names = table.names("quantity")
    with svg_plot(path, 2, len(names), figsize=(12.0, 5.5), sharey="row") as (_, axes):
        for column, quantity in enumerate(names):
            points = table.where(quantity=quantity)
            for row, cost in enumerate(("processor_s", "peak_mib")):
                label = f"exponent {exponent_of(points, cost):.2f}"
                axes[row, column].loglog(
                    points.column("value"),
                    points.column(cost),
                    "o-",
                    color=COLOURS[row],
                    label=label,
                )
            axes[1, column].set_xlabel(UNITS[quantity])
        axes[0, 0].set_ylabel("processor time, s")
        axes[1, 0].set_ylabel("peak memory, MiB")


def main():
    """Measure and write."""
    options = options_of(__doc__, decades=3.0, child=json.loads)
    if options.child:
        child(options.child)
    else:
        publish(options, page, draw, complexity=rows_of(options.decades))


if __name__ == "__main__":
    main()
