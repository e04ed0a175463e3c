"""First detections: by class, sensor, climate and cloud, from the engine and from every look's probability.

    python benchmarks/first_detection.py [--targets 200] [--climates 5] [--write docs/benchmarks]

A launch of each class is repeated many times, each time with dice of its own, in one run of the engine. What it finds
first, and when and how high, is held against the distribution that follows exactly from the probabilities of its looks:
the first detection is at look k with probability p(k) times the product of 1 - p over the looks before it. Where it
does not fit, the script fails. `--write`
puts tables, and, where matplotlib is installed, a plot into a folder.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from opir_core.geometry import ecef_to_geodetic
from opir_core.planning.looks import Looks, exposures
from opir_core.planning.plan import Plan, compile_plan
from opir_core.planning.sensor_states import SensorStates
from opir_core.scene.reading import scene_from_mapping
from opir_core.scene.scene import Scene
from opir_core.simulation.engine import Engine

CLIMATES = ("us1976", "tropical", "midlat_summer", "midlat_winter", "subarctic_winter")
CLOUDS: dict[str, dict[str, Any] | None] = {
    "clear sky": None,
    "cloud to 10 km": {"top_km": 10.0},
    "half covered to 6 km": {"top_km": 6.0, "cover": 0.5, "cell_km": 100.0},
}
SENSORS = {"DSP": -95.0, "SBIRS-GEO": -105.0, "NEXTGEN-GEO": -115.0}
LAUNCHES = {
    "SRBM": {"launch": (35.0, -110.0), "aim": (38.0, -108.0)},
    "IRBM": {"launch": (35.0, -110.0), "aim": (50.0, -85.0)},
    "ICBM": {"launch": (35.0, -110.0), "aim": (60.0, 60.0)},
}
DURATION_S = 200.0
IGNITION_S = 2.0

#: Confidence of all comparisons together.
CONFIDENCE = 0.999

PAGE = """# First detections

Made by `python benchmarks/first_detection.py --write docs/benchmarks`: one launch of each class at 35° N, 110° W,
seen from the geostationary slots {slots}, `detection: snr`, `atmosphere: lowtran`, `background: earth` by day, all else
by default. Of each: seconds after ignition and height at which half of the launches that are ever detected in their
burn have been, and the share of launches that are. Notional plumes, notional noise: what differs between lines is
physics, the absolute figures are not any system's. Half a cover of cloud hides or does not hide this one place; it is
drawn once a run.

{tables}

Each of the {cells} cells is from {targets} launches with dice of their own. The shares of launches detected until a
time, from the engine, differ from those that follow exactly from the probabilities of the looks by no more than
{worst:.2f} of the bound of Dvoretzky, Kiefer, Wolfowitz and Massart at {confidence:g} for all {cells} comparisons
together (Bonferroni). A missile in its burn rises, so heights have the same distribution.

What a cloud hides it also darkens: over its cold top DSP has less clutter of long waves than over warm ground, and sees
more of the faintest plume once that is above it. In clear long waves a bright one is seen from the ground up; in the
bands near 2.7 and 4.3 µm each has first to climb out of the water vapour and carbon dioxide that hide it.

![Height of first detection by class, sensor and sky](first_detection.svg)
"""


class Cell(NamedTuple):
    """What became of a class, a sensor and a sky."""

    kind: str
    sensor: str
    climate: str
    cloud: str
    time_s: float
    height_km: float
    share: float
    ratio: float


def scene(climate: str, cloud: str, targets: int, exact: bool, kinds: tuple[str, ...] = tuple(LAUNCHES)) -> Scene:
    """Return a scene with each launch repeated."""
    atmosphere: dict[str, Any] = {"model": "lowtran", "climate": climate}
    if CLOUDS[cloud] is not None:
        atmosphere["cloud"] = CLOUDS[cloud]
    rows = [
        {
            "id": f"{kind}-{number}",
            "type": kind,
            "launch": {
                "lat_deg": LAUNCHES[kind]["launch"][0],
                "lon_deg": LAUNCHES[kind]["launch"][1],
                "time_s": IGNITION_S,
            },
            "aim": {"lat_deg": LAUNCHES[kind]["aim"][0], "lon_deg": LAUNCHES[kind]["aim"][1]},
        }
        for kind in kinds
        for number in range(targets)
    ]
    mapping = {
        "scene": "first-detection",
        "epoch": "2026-04-01T19:00:00Z",
        "duration_s": DURATION_S,
        "seed": 11,
        "sensors": [{"model": model, "id": model, "orbital_slot_deg": slot} for model, slot in SENSORS.items()],
        "targets": rows,
        "detection": {"model": "snr", "exact": exact},
        "atmosphere": atmosphere,
        "background": "earth",
        "outputs": [],
    }
    return scene_from_mapping(mapping)


class Law(NamedTuple):
    """The looks of one sensor at one launch: when light left, how high, and the chance that this detects first."""

    emission_s: NDArray[np.float64]
    height_m: NDArray[np.float64]
    first: NDArray[np.float64]


def laws(plan: Plan) -> dict[tuple[int, int], Law]:
    """Return the law of the first detection by sensor and target, from every look's probability."""
    looks = Looks.between(plan.pairs, 0, plan.end_ns)
    exposed = exposures(plan, SensorStates.of(plan.sensors), looks.pair, looks.scan, geometry=True)
    chance = plan.detection.probability(exposed)
    found = {}
    for pair in np.unique(looks.pair).tolist():
        rows = np.flatnonzero(looks.pair == pair)
        missed = np.cumprod(np.concatenate([[1.0], 1.0 - chance[rows][:-1]]))
        height = ecef_to_geodetic(exposed.target_ecef_m[rows]).height_m
        key = int(plan.pairs.sensor[pair]), int(plan.pairs.target[pair])
        found[key] = Law(exposed.emission_time_s[rows], height, chance[rows] * missed)
    return found


def first_times(plan: Plan) -> NDArray[np.float64]:
    """Return when the light of first detections left (sensors, targets), s; inf where there is none."""
    first = np.full((len(plan.sensors), len(plan.targets.ids)), np.inf)
    engine = Engine(plan)
    step_ns = 5 * 10**9
    for end_ns in range(step_ns, plan.end_ns + step_ns, step_ns):
        window = engine.advance(min(end_ns, plan.end_ns))
        real = window.truth.target >= 0
        where = window.detections.sensor[real], window.truth.target[real]
        np.minimum.at(first, where, window.truth.emission_time_s[real])
    return first


def cells(climate: str, cloud: str, targets: int, comparisons: int) -> Iterator[Cell]:
    """Yield what becomes of all classes and sensors under one sky."""
    kinds = tuple(LAUNCHES)
    by_look = laws(compile_plan(scene(climate, cloud, 1, exact=True)))
    plan = compile_plan(scene(climate, cloud, targets, exact=False))
    first = first_times(plan)
    bound = np.sqrt(np.log(2.0 * comparisons / (1.0 - CONFIDENCE)) / (2.0 * targets))
    for number, kind in enumerate(kinds):
        own = slice(number * targets, (number + 1) * targets)
        for sensor, name in enumerate(SENSORS):
            law = by_look.get((sensor, number), Law(np.zeros(0), np.zeros(0), np.zeros(0)))
            times = first[sensor, own]
            seen = times[np.isfinite(times)]
            off = np.abs(np.searchsorted(np.sort(seen), law.emission_s + 1e-6) / targets - np.cumsum(law.first))
            ratio = float(off.max(initial=len(seen) / targets if not len(off) else 0.0) / bound)
            share = float(law.first.sum())
            middle = int(np.searchsorted(np.cumsum(law.first), 0.5 * share)) if share > 0.0 else 0
            yield Cell(
                kind=kind,
                sensor=name,
                climate=climate,
                cloud=cloud,
                time_s=float(law.emission_s[middle] - IGNITION_S) if len(law.first) else float("nan"),
                height_km=float(law.height_m[middle] / 1e3) if len(law.first) else float("nan"),
                share=share,
                ratio=ratio,
            )


def shown(cell: Cell) -> str:
    """Return a cell of the table."""
    if cell.share < 0.01:
        return f"never ({100.0 * cell.share:.2g} %)"
    return f"{cell.time_s:.0f} s, {cell.height_km:.1f} km ({100.0 * cell.share:.3g} %)"


def tables(found: list[Cell], climates: tuple[str, ...]) -> str:
    """Return one table a kind of cloud."""
    parts = []
    for cloud in CLOUDS:
        parts += [f"## {cloud.capitalize()}\n", f"| class | sensor | {' | '.join(climates)} |"]
        parts += ["|---" * (2 + len(climates)) + "|"]
        for kind in LAUNCHES:
            for sensor in SENSORS:
                own = [c for c in found if (c.kind, c.sensor, c.cloud) == (kind, sensor, cloud)]
                parts.append(f"| {kind} | {sensor} | {' | '.join(shown(cell) for cell in own)} |")
        parts.append("")
    return "\n".join(parts).strip()


def write_plot(found: list[Cell], path: Path) -> None:
    """Write heights of first detection: a panel a cloud, a group a class, a mark a climate."""
    import matplotlib as mpl

    mpl.use("svg")
    mpl.rcParams.update({"svg.hashsalt": "opir", "svg.fonttype": "none"})
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, len(CLOUDS), figsize=(10, 4), sharey=True, constrained_layout=True)
    lines = [(kind, sensor) for kind in LAUNCHES for sensor in SENSORS]
    for axis, cloud in zip(axes, CLOUDS, strict=True):
        for number, climate in enumerate(CLIMATES):
            own = [c for c in found if c.cloud == cloud and c.climate == climate and c.share >= 0.01]
            places = [lines.index((c.kind, c.sensor)) + 0.12 * (number - 2) for c in own]
            axis.plot(places, [c.height_km for c in own], ".", label=climate)
        axis.set(title=cloud, yscale="symlog", xticks=range(len(lines)))
        axis.set_xticklabels([f"{kind} {sensor}" for kind, sensor in lines], rotation=90, fontsize=7)
        axis.grid(axis="y", alpha=0.3)
    axes[0].set_ylabel("median height of first detection, km")
    axes[-1].legend(fontsize=7)
    figure.savefig(path, metadata={"Date": None})


def main() -> None:
    """Run all skies and print; write where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--targets", type=int, default=200)
    parser.add_argument("--climates", type=int, default=len(CLIMATES))
    parser.add_argument("--write", type=Path)
    options = parser.parse_args()
    climates = CLIMATES[: options.climates]
    comparisons = len(climates) * len(CLOUDS) * len(LAUNCHES) * len(SENSORS)
    found = [
        cell for cloud in CLOUDS for climate in climates for cell in cells(climate, cloud, options.targets, comparisons)
    ]
    text, worst = tables(found, climates), max(cell.ratio for cell in found)
    print(text)
    print(f"\n{len(found)} cells, worst distance over its bound: {worst:.2f}")
    if worst > 1.0:
        raise SystemExit("the engine's first detections are not those of the probabilities of their looks")
    if options.write:
        page = PAGE.format(
            tables=text,
            cells=len(found),
            targets=options.targets,
            worst=worst,
            confidence=CONFIDENCE,
            slots=", ".join(f"{-slot:g}° W ({name})" for name, slot in SENSORS.items()),
        )
        (options.write / "first_detection.md").write_text(page, encoding="utf-8")
        write_plot(found, options.write / "first_detection.svg")


if __name__ == "__main__":
    main()
