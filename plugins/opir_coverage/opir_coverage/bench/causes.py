"""False alarms a day by cause, and the air in the bands of a sensor."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from opir_core import Plan, run_of_plan
from opir_coverage.bench.results import BenchLine, BenchPlot, BenchResult
from opir_coverage.bench.stand import Bench, Poses

_DAY_S = 86_400.0


def false_alarms(plan: Plan) -> BenchResult:
    """Return the false alarms a day of each sensor of a scene by cause.

    Noise is what the detection model expects; fires, flares, glints and bolides are counted in one
    run of the scene, with its seed, and scaled to a day.
    """
    rate = plan.detection.rate_per_scan
    counts: Counter[tuple[int, str]] = Counter()
    if plan.sources:
        found = run_of_plan(plan)
        truth = found.truth.target
        for sensor, target in zip(
            found.detections.sensor.tolist(), np.asarray(truth).tolist(), strict=True
        ):
            if target >= len(plan.scene.targets):
                counts[sensor, plan.targets.class_names[target]] += 1
    causes = sorted({cause for _, cause in counts})
    rows = []
    for number, sensor in enumerate(plan.sensors):
        period_s = sensor.scan.period_ns * 1e-9
        noise = 0.0 if rate is None else float(rate[number]) * _DAY_S / period_s
        scaled = [counts[number, cause] * _DAY_S / plan.scene.duration_s for cause in causes]
        rows.append([sensor.id, noise, *scaled])
    names = ["noise", *causes]
    lines = [
        BenchLine(name, np.zeros(len(rows)), np.array([row[place + 1] for row in rows]))
        for place, name in enumerate(names)
    ]
    plot = BenchPlot(
        x_label="",
        y_label="detections a day",
        lines=lines,
        names=[str(row[0]) for row in rows],
        log_y=True,
    )
    notes = (
        [f"sources: counted in one run of {plan.scene.duration_s:g} s, seed {plan.scene.seed}"]
        if causes
        else []
    )
    return BenchResult(
        title=f"False alarms a day in {plan.scene.name}",
        head=("sensor", *names),
        rows=rows,
        plot=plot,
        notes=notes,
    )


def window(
    bench: Bench, elevation_rad: float, heights_km: Sequence[float] = (0.0, 5.0, 10.0, 15.0, 20.0)
) -> BenchResult:
    """Return the transmittance from heights to space in the bands of a sensor, as the scene's
    atmosphere has it.
    """
    height_m = 1e3 * np.array(heights_km)
    found = bench.signals(Poses.of(height_m=height_m, elevation_rad=elevation_rad))
    bands = bench.sensor.bands
    rows = [
        [f"{band.name}", band.lower_um, band.upper_um, *found.transmittance[:, place]]
        for place, band in enumerate(bands)
    ]
    lines = [
        BenchLine(f"from {height:g} km", np.zeros(len(bands)), found.transmittance[row])
        for row, height in enumerate(heights_km)
    ]
    names = [f"{band.name} {band.lower_um:g}–{band.upper_um:g} µm" for band in bands]
    plot = BenchPlot(x_label="", y_label="transmittance to space", lines=lines, names=names)
    head = ("band", "from um", "to um", *(f"{height:g} km" for height in heights_km))
    title = f"Air in the bands of {bench.sensor.id}, elevation {np.degrees(elevation_rad):g}°"
    return BenchResult(title=title, head=head, rows=rows, plot=plot)
