"""False alarms a day by cause, and the air in the bands of a sensor."""

from collections import Counter
from collections.abc import Sequence

import numpy as np
from attrs import evolve

from opir_bench.results import BenchResult, bars
from opir_bench.stand import DAY_S, Bench, Poses, noise_alarms_a_day
from opir_core import Plan, run_of_plan


def false_alarms(plan: Plan) -> BenchResult:
    """Return the false alarms a day of each sensor of a scene by cause.

    Noise is what the detection model expects; fires, flares, glints and bolides are counted in one
    run of the scene, with its seed, and scaled to a day.
    """
    counts = _source_counts(plan)
    causes = sorted({cause for _, cause in counts})
    sensors = plan.sensors
    columns = {"noise": noise_alarms_a_day(plan, 0.0)}
    for cause in causes:
        number = np.array([counts[sensor, cause] for sensor in range(len(sensors))])
        columns[cause] = number * DAY_S / plan.scene.duration_s
    rows = [
        [sensor.id, *(column[row] for column in columns.values())]
        for row, sensor in enumerate(sensors)
    ]
    plot = bars([sensor.id for sensor in sensors], "detections a day", columns)
    scene = plan.scene
    notes = [f"sources: counted in one run of {scene.duration_s:g} s, seed {scene.seed}"]
    return BenchResult(
        f"False alarms a day in {scene.name}",
        ("sensor", *columns),
        rows,
        evolve(plot, log_y=True),
        notes if causes else [],
    )


def _source_counts(plan: Plan) -> Counter[tuple[int, str]]:
    """Return the detections of sources in one run, by sensor and cause."""
    counts: Counter[tuple[int, str]] = Counter()
    if plan.sources:
        run = run_of_plan(plan)
        targets = np.asarray(run.truth.target).tolist()
        for sensor, target in zip(run.detections.sensor.tolist(), targets, strict=True):
            if target >= len(plan.scene.targets):
                counts[sensor, plan.targets.class_names[target]] += 1
    return counts


def window(
    bench: Bench, elevation_rad: float, heights_km: Sequence[float] = (0.0, 5.0, 10.0, 15.0, 20.0)
) -> BenchResult:
    """Return the transmittance of the scene's air from heights to space in a sensor's bands."""
    height_m = 1e3 * np.array(heights_km)
    signals = bench.signals(Poses.of(height_m=height_m, elevation_rad=elevation_rad))
    bands = bench.sensor.bands
    rows = [
        [f"{band.name}", band.lower_um, band.upper_um, *signals.transmittance[:, place]]
        for place, band in enumerate(bands)
    ]
    columns = {
        f"from {height:g} km": signals.transmittance[row] for row, height in enumerate(heights_km)
    }
    names = [f"{band.name} {band.lower_um:g}–{band.upper_um:g} µm" for band in bands]
    plot = bars(names, "transmittance to space", columns)
    head = ("band", "from um", "to um", *(f"{height:g} km" for height in heights_km))
    title = f"Air in the bands of {bench.sensor.id}, elevation {np.degrees(elevation_rad):g}°"
    return BenchResult(title, head, rows, plot)
