"""Calibration: of what is reported with probability p, is a share p right? Launches, hot sources
and noise together.

    python benchmarks/calibration.py [--launches 600] [--sources 600] [--seeds 2 4] [--write
    docs/benchmarks]

Launches of every type, hot sources and false alarms are simulated and classified; the prior of the
classifier is that of the simulation: as many launches a day and as many sources in view. An event
is right if its reported type is the true one, or if it is reported UNKNOWN and is of no missile.
Levels of plumes have a spread of 0.7 in their logarithm, and any propellant burns; places, flights,
noise and confirmation are the engine's.
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from discrimination_objects import BRIGHTNESS, launched, place, seen_from
from numpy.typing import NDArray
from opir_photons.classification.configs import SpectralConfig
from work_precision.results_csv import write_csv

import opir_core as opir
from opir_core.scene.scene import TARGET_TYPES, UNKNOWN_TYPE

#: Coldest and hottest, K, and median and logarithmic spread of emissivity times area, m², as in the
#: classifier's prior.
SOURCES = {"fire": (800.0, 1200.0, 1800.0, 2.07), "flare": (1600.0, 2000.0, 9.0, 1.51)}
SHINING_S = {"fire": 21_600.0, "flare": 86_400.0}
PERIOD_S = 2.0
DURATION_S = 256.0
EDGES = np.linspace(0.0, 1.0, 11)
#: Events of a bin, and how far from the diagonal its share may be.
ENOUGH = 200
WITHIN = 0.05
SENSORS: dict[str, dict[str, Any]] = {
    "DSP": {"model": "DSP"},
    "DSP-unconfirmed": {"model": "DSP", "confirmation_detections": 1},
    "SBIRS-GEO": {"model": "SBIRS-GEO"},
    "NEXTGEN-GEO": {"model": "NEXTGEN-GEO"},
}


PAGE = """# Calibration

*If a detection is reported with confidence p, how often is it right?* Within {within:.0f} points of the diagonal lie
{good} of the {bins} bins of at least {enough} events{worst}.

![Reliability diagrams by sensor](calibration.svg)

`classification: spectral` with `confidence: posterior`, over {events} events of {launches} launches, {sources} fires
and gas flares, and noise. A report of a type is right if that is the target's type; UNKNOWN is right for what is no
missile. `DSP-unconfirmed`, with `confirmation_detections: 1`, reports every detection, noise included ({noise}).

The prior of the classifier is that of the simulation: as many launches and sources. Levels of plumes are drawn with a
spread of {brightness:g} in their logarithm, each with one of five propellants; areas of sources with the spreads of
`hot_sources.json`. All sensors look every {period:g} s (default: 10, 0.1 and 0.05 s) through `midlat_summer`
air over the Earth; all else is default: focal planes, DSP with its preset `heritage`. The difference of frames takes
away most fires and flares. Events of one launch share its brightness, so intervals (95 %) are over launches and
sources: by them {chance} of the {bad} bins that are off may lie within {within:.0f} points.

**What is left.** The classifier's densities are mixtures of normal distributions of {trained} synthetic launches of
each flight: where types overlap they are good to some points. How often each is detected in each part of the Earth's
disc is part of them.

All bins: [calibration.csv](calibration.csv).
"""


class Bin(NamedTuple):
    """Events of a sensor with confidences in a bin: their number, mean confidence and the share
    that is right.

    `emitters` is of how many of them they are, `half_95` half of the 95 % interval of share less
    confidence over these.
    """

    sensor: str
    what: str
    lower: float
    events: int
    confidence: float
    right: float
    emitters: int
    half_95: float


def binned(
    sensor: str,
    what: str,
    lower: float,
    confidence: NDArray[np.float64],
    right: NDArray[np.bool_],
    emitter: NDArray[Any],
) -> Bin:
    """Return the bin of events (n,). Those of one emitter are dependent: the interval is over
    emitters.
    """
    off = right - confidence
    _, row = np.unique(emitter, return_inverse=True)
    rest = np.bincount(row, off) - off.mean() * np.bincount(row)
    half = 1.96 * float(np.sqrt(np.sum(np.square(rest)))) / len(off)
    return Bin(
        sensor,
        what,
        lower,
        len(off),
        float(confidence.mean()),
        float(right.mean()),
        len(rest),
        half,
    )


def scene(launches: int, sources: int, seed: int) -> dict[str, Any]:
    """Return a scene with launches of every type and sources of each kind, and a prior that says
    so.
    """
    rng = np.random.default_rng([seed, 29])
    targets = [launched(rng, kind, number) for kind in TARGET_TYPES for number in range(launches)]
    classification = {
        "model": "spectral",
        "launches_per_day": 86_400.0 / DURATION_S * len(targets),
        "prior": dict.fromkeys(TARGET_TYPES, 1.0 / len(TARGET_TYPES)),
        "sources_in_view": {
            kind: float(sources * SHINING_S[kind] / DURATION_S) for kind in SOURCES
        },
    }
    found = seen_scene(
        SENSORS,
        PERIOD_S,
        DURATION_S,
        seed,
        targets,
        [sourced(rng, kind, sources) for kind in SOURCES],
    )
    return {**found, "classification": classification, "confidence": "posterior"}


def seen_scene(
    sensors: Mapping[str, Mapping[str, Any]],
    period_s: float,
    duration_s: float,
    seed: int,
    targets: Sequence[dict[str, Any]],
    sources: Sequence[dict[str, Any]],
) -> dict[str, Any]:
    """Return a scene of sensors over the Gulf of Guinea with targets and sources, through air and
    over the Earth.
    """
    return {
        "scene": "calibration",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": duration_s,
        "seed": seed,
        "sensors": [
            {"id": name, "orbital_slot_deg": 0.0, "scan_period_ms": 1e3 * period_s, **settings}
            for name, settings in sensors.items()
        ],
        "targets": targets,
        "sources": sources,
        "detection": "snr",
        "atmosphere": {"model": "lowtran", "climate": "midlat_summer"},
        "background": "earth",
        "outputs": [],
    }


def bin_numbers(probability: NDArray[np.float64], edges: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the bins of probabilities between edges (k + 1,)."""
    return np.clip(np.searchsorted(edges, probability, side="right") - 1, 0, len(edges) - 2)


def sourced(rng: np.random.Generator, kind: str, count: int) -> dict[str, Any]:
    """Return a block of sources of a kind."""
    coldest, hottest, median, spread = SOURCES[kind]
    rows = []
    for _ in range(count):
        where = seen_from(np.arcsin(rng.uniform(0.02, 1.0)), 2.0 * np.pi * rng.random())
        rows.append(
            {
                **place(*where),
                "height_m": float(rng.uniform(0.0, 1000.0)),
                "temperature_k": float(rng.uniform(coldest, hottest)),
                "area_m2": float(median * np.exp(spread * rng.standard_normal())),
            }
        )
    return {"id": kind, "model": f"{kind}s", "emissivity": 1.0, "at": rows}


def events(
    run: opir.Run, truths: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
    """Return confidences, whether they are right, and whether events are reported as missiles."""
    true = np.where(run.truth.target >= 0, truths[run.truth.target], UNKNOWN_TYPE)
    reported = run.detections.reported_type
    return run.detections.confidence, reported == true, reported != UNKNOWN_TYPE


def main() -> None:
    """Simulate, print and write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--launches", type=int, default=600)
    parser.add_argument("--sources", type=int, default=600)
    parser.add_argument("--seeds", type=int, nargs="+", default=[2, 4])
    parser.add_argument("--write", type=Path)
    arguments = parser.parse_args()
    parts: dict[str, list[Any]] = {name: [] for name in SENSORS}
    for seed in arguments.seeds:
        mapping = scene(arguments.launches, arguments.sources, seed)
        run = opir.simulate(opir.scene_from_mapping(mapping))
        kinds = [TARGET_TYPES.index(target["type"]) for target in mapping["targets"]]
        truths = np.array(kinds + [UNKNOWN_TYPE] * (arguments.sources * len(SOURCES)))
        confidence, right, missile = events(run, truths)
        for number, name in enumerate(SENSORS):
            own = run.detections.sensor == number
            target = run.truth.target[own]
            # Each false alarm is by itself.
            emitter = np.where(target < 0, -1 - np.arange(len(target)), target) + seed * 1j
            parts[name].append((confidence[own], right[own], missile[own], emitter))
    found = []
    noise = {}
    for name, of_seeds in parts.items():
        confidence, right, missile, emitter = (
            np.concatenate(column) for column in zip(*of_seeds, strict=True)
        )
        noise[name] = float(np.mean(emitter.real < 0))
        print(
            f"{name}: {len(confidence)} events, {noise[name]:.1%} noise, missile"
            f" {np.mean(missile):.1%}"
        )
        number = bin_numbers(confidence, EDGES)
        for what, chosen in (("missile", missile), ("UNKNOWN", ~missile)):
            for each, lower in enumerate(EDGES[:-1].tolist()):
                rows = chosen & (number == each)
                if rows.any():
                    row = binned(name, what, lower, confidence[rows], right[rows], emitter[rows])
                    found.append(row)
                    mark = (
                        " !"
                        if row.events >= ENOUGH and abs(row.confidence - row.right) > WITHIN
                        else ""
                    )
                    print(
                        f"  {what} {lower:.1f}: {row.events:7d} {row.confidence:.3f}"
                        f" {row.right:.3f}"
                        f" ± {row.half_95:.3f}{mark}"
                    )
    if arguments.write:
        facts = {
            "events": sum(row.events for row in found),
            "launches": arguments.launches * len(TARGET_TYPES) * len(arguments.seeds),
            "sources": arguments.sources * len(SOURCES) * len(arguments.seeds),
            "noise": f"{noise['DSP-unconfirmed']:.1%}",
        }
        write_csv(arguments.write / "calibration.csv", found, facts)
        (arguments.write / "calibration.md").write_text(page(found, facts), encoding="utf-8")
        write_plot(found, arguments.write / "calibration.svg")


def page(found: list[Bin], facts: dict[str, Any]) -> str:
    """Return the page."""
    large = [row for row in found if row.events >= ENOUGH]
    off = {row: abs(row.confidence - row.right) for row in large}
    bad = sorted((row for row in large if off[row] > WITHIN), key=lambda row: -off[row])
    listed = "; ".join(
        f"{row.sensor} {row.what} at {row.confidence:.2f}: {row.right:.2f} ± {row.half_95:.2f}"
        for row in bad
    )
    return PAGE.format(
        **{name: facts[name] for name in ("events", "launches", "sources", "noise")},
        within=100.0 * WITHIN,
        good=len(large) - len(bad),
        bins=len(large),
        enough=ENOUGH,
        worst=f". The others: {listed}" if bad else "",
        chance=sum(off[row] - row.half_95 <= WITHIN for row in bad),
        bad=len(bad),
        period=PERIOD_S,
        brightness=BRIGHTNESS,
        trained=SpectralConfig().launches,
    )


def write_plot(found: list[Bin], path: Path) -> None:
    """Draw a reliability diagram for each sensor, with marks by the number of events."""
    import matplotlib as mpl

    mpl.use("svg")
    mpl.rcParams.update({"svg.hashsalt": "opir", "svg.fonttype": "none"})
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(
        1, len(SENSORS), figsize=(12, 3.4), sharey=True, constrained_layout=True
    )
    for axis, name in zip(axes, SENSORS, strict=True):
        axis.plot([0.0, 1.0], [0.0, 1.0], color="0.6", linewidth=0.8)
        for what, marker in (("missile", "o"), ("UNKNOWN", "s")):
            rows = [
                row
                for row in found
                if row.sensor == name and row.what == what and row.events >= ENOUGH
            ]
            sizes = [8.0 + 8.0 * np.log10(row.events / ENOUGH) for row in rows]
            axis.scatter(
                [r.confidence for r in rows],
                [r.right for r in rows],
                sizes,
                marker=marker,
                label=what,
            )
        axis.set(title=name, xlabel="confidence")
    axes[0].set_ylabel("share that is right")
    axes[0].legend(fontsize=8)
    figure.savefig(path, metadata={"Date": None})


if __name__ == "__main__":
    main()
