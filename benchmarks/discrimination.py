"""Plumes against fires, flares and glints, and the types of launches: one look each, through the whole engine.

    python benchmarks/discrimination.py [--launches 150] [--sources 150] [--seed 1] [--write docs/benchmarks]

Launches of each type and hot sources of each kind, drawn at random below one geostationary place, are simulated with
every sensor at that place. Of each one moment is drawn, the same for all sensors, and the look at that moment is
judged: so looks are independent, and sensors are compared in pairs. `--write` makes the page and its plots.
"""

import argparse
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta, binomtest, norm, rankdata

import opir_core as opir
from opir_core.flight.profiles import PROFILES_BY_TYPE, boost_profile
from opir_core.radiometry.plume import plume_table
from opir_core.records import FloatArray, Run
from opir_core.scene import REPORTED_TYPES, TARGET_TYPES

SENSORS = ("DSP", "SBIRS-GEO", "NEXTGEN-GEO")
KINDS = ("fire", "flare", "glint")
PERIOD_S, DURATION_S = 2.0, 256.0
RADIUS_KM, SLOT_KM = 6371.0, 42164.2
BRIGHTNESS, COLOUR, AREA = 0.2, 0.05, 1.0
CODES = (*REPORTED_TYPES, "not detected")

PAGE = """# Discrimination and classification

Made by `python benchmarks/discrimination.py --write docs/benchmarks`: {launches} launches of each type and {sources}
fires, gas flares and sun glints each, seed {seed}, below one geostationary place by day (noon, midlatitude summer, no
cloud). Places are drawn evenly in the sine of the elevation, headings evenly, ranges evenly in the logarithm within the
class, brightness with a spread of {brightness} (all bands) and {colour} (each band) in the logarithm, areas with one of
{area}; glints within 10° of the point that mirrors the Sun. One look of each at a random moment, the same for all
sensors, which look every {period:g} s. Sensors have their defaults, which are notional. Intervals are 95 %.

## Plume against fire, flare and glint

The statistic is the logarithm of the likelihood ratio, plume over anything else, of `classification: spectral`, on
sensors that detect with any band (`spectral_discrimination: none`), so that the ratio alone tells. The area under the
curve is the chance that a plume scores above the other, ties counting half; its interval is DeLong's (Biometrics 44,
1988, 837), and where no scores overlap Clopper and Pearson's for the smaller number of objects. *Of detections* is what
the ratio does with what it gets. *Of looks* an object that is not detected scores below all that are: a sensor that
detects fires and not plumes is below the diagonal. Crosses are the sensors' own ratio gates.

{areas}

![ROC curves of plume against fire, flare and glint, by sensor, with 95 % bands](discrimination.svg)

Differences of areas, plume against all three kinds together, on the same objects (one-sided; the variance is that of
DeLong's placements, linearised where objects are not detected):

{area_order}

## Types

Rows are true types; in percent of looks at launches of a type, with Clopper and Pearson's intervals. The classifier has
its defaults: a type is reported from a probability of 0.6 on.

{confusion}

![What looks at launches of each type are reported as, by sensor](classification.svg)

Looks at launches that are detected and told their type, and how sure the difference is (exact McNemar test on the same
looks, one-sided):

{type_order}

## What it rests on

{remarks}
"""

REMARKS = """- The order is that of bands and noise: nothing in a sensor's description says how well it discriminates.
- The range is known to a percent or so from geostationary height, so brightness itself tells types apart where noise
  does not hide it. Upper stages are notionally a third and a tenth as bright as the first: late in its burn an ICBM is
  as bright as a smaller type, and what tells it from that is the number of detections so far.
- DSP has one band. It tells fires, whose long-wave light is far above plumes', and cannot tell a flare or a glint of a
  plume's brightness from one; faint launches are below its noise. What it does detect is bright, and so mostly an ICBM.
- The second band of SBIRS-GEO gives a temperature; the third of NEXTGEN-GEO and its lower noise give the spectrum.
- Gates cost detections: low in the air the ratios of bands are not those of a plume higher up, and a small plume's
  long-wave light is below the coincidence threshold. The likelihood ratio on any band's detections loses fewer of them.
"""


class Population(NamedTuple):
    """A scene's plain values; of each emitter its kind (a type, or a kind of source) and the moment looked at."""

    scene: dict[str, Any]
    kind: NDArray[np.str_]
    moment_s: FloatArray


class Looks(NamedTuple):
    """Of one sensor, for each emitter: ln of the likelihood ratio (-inf undetected), reported code, posterior."""

    log_ratio: FloatArray
    code: NDArray[np.int64]
    probability: FloatArray


def population(launches: int, sources: int, seed: int) -> Population:
    """Return launches of each type and sources of each kind, with every sensor, twice: with and without its gates."""
    rng = np.random.default_rng([seed, 17])
    targets = [launched(rng, kind, number) for kind in TARGET_TYPES for number in range(launches)]
    blocks = [sourced(rng, kind, sources) for kind in KINDS]
    sensors = [
        {"model": model, "id": f"{model}{suffix}", "orbital_slot_deg": 0.0, "scan_period_ms": 1e3 * PERIOD_S, **rule}
        for model in SENSORS
        for suffix, rule in (("", {}), ("-ANY", {"spectral_discrimination": "none"}))
    ]
    scene = {
        "scene": "discrimination",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": DURATION_S,
        "seed": seed,
        "sensors": sensors,
        "targets": targets,
        "sources": blocks,
        "detection": "snr",
        "classification": "spectral",
        "atmosphere": {"model": "lowtran", "climate": "midlat_summer"},
        "background": "earth",
    }
    kind = np.array([*(target["type"] for target in targets), *(k for k in KINDS for _ in range(sources))])
    burn_s = np.array([boost_profile(target["profile"]).burn_time_s for target in targets])
    within_s = np.concatenate([burn_s, np.full(len(KINDS) * sources, DURATION_S)])
    return Population(scene, kind, moments_s(rng, within_s))


def moments_s(rng: np.random.Generator, within_s: FloatArray) -> FloatArray:
    """Return moments (n,) of looks, drawn evenly within spans (n,) of scene time."""
    drawn: FloatArray = PERIOD_S * np.ceil(rng.random(len(within_s)) * np.floor(within_s / PERIOD_S - 0.5))
    return drawn


def launched(rng: np.random.Generator, kind: str, number: int) -> dict[str, Any]:
    """Return a launch of a type."""
    profile = boost_profile(str(rng.choice(PROFILES_BY_TYPE[kind])))
    latitude, longitude = seen_from(np.arcsin(rng.uniform(0.03, 1.0)), 2.0 * np.pi * rng.random())
    limits = np.log([1.02 * profile.minimum_range_m, min(profile.maximum_range_m, 1.5e7) / 1.02])
    angle = float(np.exp(rng.uniform(*limits))) / 1e3 / RADIUS_KM
    aim = moved(latitude, longitude, angle, 2.0 * np.pi * rng.random())
    spread = BRIGHTNESS * rng.standard_normal() + COLOUR * rng.standard_normal(3)
    peaks = plume_table()["peak_w_sr"][profile.name]
    brightness = {name: float(peak * np.exp(more)) for (name, peak), more in zip(peaks.items(), spread, strict=True)}
    return {
        "id": f"{kind}-{number}",
        "type": kind,
        "profile": profile.name,
        "launch": place(latitude, longitude),
        "aim": place(*aim),
        "signature": {"model": "plume", "peak_w_sr": brightness},
    }


def sourced(rng: np.random.Generator, kind: str, count: int) -> dict[str, Any]:
    """Return a block of sources of a kind."""
    rows = []
    for area in {"fire": 2000.0, "flare": 30.0, "glint": 1e6}[kind] * np.exp(AREA * rng.standard_normal(count)):
        if kind == "glint":
            where = np.radians(2.2 + rng.uniform(-10.0, 10.0)), np.radians(rng.uniform(-10.0, 10.0))
        else:
            where = seen_from(np.arcsin(rng.uniform(0.03, 1.0)), 2.0 * np.pi * rng.random())
        row = {**place(*where), "area_m2": float(area)}
        if kind != "glint":
            row["temperature_k"] = float(rng.uniform(*{"fire": (800.0, 1200.0), "flare": (1600.0, 2000.0)}[kind]))
        rows.append(row)
    return {"id": kind, "model": f"{kind}s", "at": rows}


def seen_from(elevation: float, bearing: float) -> tuple[float, float]:
    """Return latitude and longitude, rad, of a place that has the satellite at an elevation, rad."""
    angle = float(np.arccos(RADIUS_KM * np.cos(elevation) / SLOT_KM) - elevation)
    return moved(0.0, 0.0, angle, bearing)


def moved(latitude: float, longitude: float, angle: float, heading: float) -> tuple[float, float]:
    """Return the place at an angle from another, on a sphere."""
    sine = np.sin(latitude) * np.cos(angle) + np.cos(latitude) * np.sin(angle) * np.cos(heading)
    across = np.sin(heading) * np.sin(angle) * np.cos(latitude)
    return float(np.arcsin(sine)), longitude + float(np.arctan2(across, np.cos(angle) - np.sin(latitude) * sine))


def place(latitude: float, longitude: float) -> dict[str, float]:
    """Return a place as scenes write it."""
    return {"lat_deg": float(np.degrees(latitude)), "lon_deg": float((np.degrees(longitude) + 180.0) % 360.0 - 180.0)}


def simulated(people: Population) -> tuple[Any, Run]:
    """Return the classifier and the run of a population."""
    scene = opir.scene_from_mapping(people.scene)
    return opir.compile_plan(scene).classifier, opir.simulate(scene)


def looks_at(people: Population, classifier: Any, run: Run) -> dict[str, Looks]:
    """Return, by sensor id, what the engine says of each emitter at its moment."""
    found, target = run.detections, run.truth.target
    due = np.append(np.round(people.moment_s * 1e9).astype(np.int64), -1)[target]
    log_ratio = classifier.log_ratio(found.type_log_probability)
    looks = {}
    for number, sensor in enumerate(run.sensors):
        rows = np.flatnonzero((found.sensor == number) & (found.time_ns == due))
        score, code = np.full(len(people.kind), -np.inf), np.full(len(people.kind), len(REPORTED_TYPES))
        probability = np.full((len(people.kind), 4), np.nan)
        score[target[rows]], code[target[rows]] = log_ratio[rows], found.reported_type[rows]
        probability[target[rows]] = found.type_probability[rows]
        looks[sensor.id] = Looks(score, code, probability)
    return looks


def placements(plume: FloatArray, other: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how often each plume scores above the others, and each other below the plumes; ties count half."""
    m, n = len(plume), len(other)
    together = rankdata(np.concatenate([plume, other]))
    return (together[:m] - rankdata(plume)) / n, 1.0 - (together[m:] - rankdata(other)) / m


def area(plume: FloatArray, other: FloatArray) -> tuple[float, float, float]:
    """Return the area under the ROC curve with DeLong's 95 % interval, which has no width where nothing overlaps.

    There the least area is that of Clopper and Pearson for the smaller number of objects.
    """
    up, down = placements(plume, other)
    sigma = np.sqrt(up.var(ddof=1) / len(up) + down.var(ddof=1) / len(down))
    middle, fewest = float(up.mean()), min(len(up), len(down))
    if middle == 1.0:
        return middle, interval(fewest, fewest)[0], 1.0
    return middle, max(middle - 1.96 * sigma, 0.0), min(middle + 1.96 * sigma, 1.0)


def influences(plume: FloatArray, other: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Return the area of those above -inf, and what each object, seen or not, adds to it to first order."""
    seen = np.isfinite(plume), np.isfinite(other)
    parts = placements(plume[seen[0]], other[seen[1]])
    middle = float(parts[0].mean())
    added = [np.zeros(len(plume)), np.zeros(len(other))]
    for column, own, part in zip(added, seen, parts, strict=True):
        column[own] = (part - middle) / own.mean()
    return middle, added[0], added[1]


def area_gain(worse: list[FloatArray], better: list[FloatArray], *, of_looks: bool) -> tuple[float, float, float]:
    """Return how much larger an area is on the same objects, the standard deviation of that, and one-sided p.

    Both are scores of plumes and of others. Of looks, what is not seen scores below all; else it is left out.
    """
    lowest = -1e300 if of_looks else -np.inf
    found = [influences(*(np.maximum(part, lowest) for part in scores)) for scores in (worse, better)]
    gain = found[1][0] - found[0][0]
    variances = [np.var(found[1][side] - found[0][side], ddof=1) / len(found[0][side]) for side in (1, 2)]
    sigma = float(np.sqrt(sum(variances)))
    return gain, sigma, float(norm.sf(gain / sigma)) if sigma > 0.0 else 1.0


def type_gain(worse: NDArray[np.bool_], better: NDArray[np.bool_]) -> tuple[float, float]:
    """Return by how much a share of the same looks is larger, and one-sided p (McNemar, exact)."""
    more, less = int(np.sum(better & ~worse)), int(np.sum(worse & ~better))
    p = binomtest(more, more + less, 0.5, alternative="greater").pvalue if more + less else 1.0
    return (more - less) / len(worse), float(p)


def interval(hits: int, count: int) -> tuple[float, float]:
    """Return the 95 % interval of a share (Clopper and Pearson)."""
    low = 0.0 if hits == 0 else float(beta.ppf(0.025, hits, count - hits + 1))
    return low, 1.0 if hits == count else float(beta.ppf(0.975, hits + 1, count - hits))


def is_right(looks: Looks, kind: NDArray[np.str_]) -> NDArray[np.bool_]:
    """Return which looks at launches are told their type."""
    launches = np.isin(kind, TARGET_TYPES)
    right: NDArray[np.bool_] = np.array(CODES)[looks.code[launches]] == kind[launches]
    return right


def areas_table(people: Population, looks: dict[str, Looks]) -> str:
    """Return the areas of each sensor against each kind."""
    lines = [
        "| sensor | plume against | of detections | interval | counts | of looks | interval |",
        "|---|---|---|---|---|---|---|",
    ]
    plume = np.isin(people.kind, TARGET_TYPES)
    for sensor in SENSORS:
        score = looks[f"{sensor}-ANY"].log_ratio
        for kind in (*KINDS, "all"):
            other = ~plume if kind == "all" else people.kind == kind
            seen = [score[rows & np.isfinite(score)] for rows in (plume, other)]
            counts = f"{len(seen[0])} against {len(seen[1])}"
            told = [
                f"{middle:.3f} | {low:.3f} to {high:.3f}"
                for middle, low, high in (area(*seen), area(score[plume], score[other]))
            ]
            lines.append(f"| {sensor} | {kind} | {told[0]} | {counts} | {told[1]} |")
    return "\n".join(lines)


def area_orders(
    people: Population, looks: dict[str, Looks], *, of_looks: bool
) -> list[tuple[str, str, float, float, float]]:
    """Return each step of the order of sensors with gain, deviation and p."""
    plume, found = np.isin(people.kind, TARGET_TYPES), []
    for worse, better in pairwise(SENSORS):
        scores = [looks[f"{sensor}-ANY"].log_ratio for sensor in (worse, better)]
        parts = [[score[plume], score[~plume]] for score in scores]
        found.append((worse, better, *area_gain(parts[0], parts[1], of_looks=of_looks)))
    return found


def type_orders(people: Population, looks: dict[str, Looks]) -> list[tuple[str, str, float, float]]:
    """Return each step of the order of sensors with gain and p."""
    right = {sensor: is_right(looks[sensor], people.kind) for sensor in SENSORS}
    return [(worse, better, *type_gain(right[worse], right[better])) for worse, better in pairwise(SENSORS)]


def confusion_table(people: Population, looks: dict[str, Looks]) -> str:
    lines = [f"| sensor | true type | {' | '.join(CODES)} |", f"|---|---|{'---|' * len(CODES)}"]
    for sensor in SENSORS:
        for kind in TARGET_TYPES:
            codes = looks[sensor].code[people.kind == kind]
            cells = []
            for code in range(len(CODES)):
                hits = int(np.sum(codes == code))
                low, high = interval(hits, len(codes))
                cells.append(f"{100 * hits / len(codes):.0f} ({100 * low:.0f}–{100 * high:.0f})")
            lines.append(f"| {sensor} | {kind} | {' | '.join(cells)} |")
    return "\n".join(lines)


def order_tables(people: Population, looks: dict[str, Looks]) -> tuple[str, str]:
    areas = ["| of | less | more | gain | deviation | p |", "|---|---|---|---|---|---|"]
    for name, of_looks in (("detections", False), ("looks", True)):
        for worse, better, gain, sigma, p in area_orders(people, looks, of_looks=of_looks):
            areas.append(f"| {name} | {worse} | {better} | {gain:+.3f} | {sigma:.3f} | {p:.1e} |")
    types = ["| sensor | looks | told | interval | of detections |", "|---|---|---|---|---|"]
    for sensor in SENSORS:
        right = is_right(looks[sensor], people.kind)
        seen = int(np.sum(looks[sensor].code[np.isin(people.kind, TARGET_TYPES)] < len(REPORTED_TYPES)))
        low, high = interval(int(right.sum()), len(right))
        lines = f"{right.mean():.3f} | {low:.3f} to {high:.3f} | {right.sum() / max(seen, 1):.3f} of {seen}"
        types.append(f"| {sensor} | {len(right)} | {lines} |")
    types += ["", "| less | more | gain | p |", "|---|---|---|---|"]
    types += [f"| {a} | {b} | {gain:+.3f} | {p:.1e} |" for a, b, gain, p in type_orders(people, looks)]
    return "\n".join(areas), "\n".join(types)


def roc(plume: FloatArray, other: FloatArray, at: FloatArray) -> FloatArray:
    """Return the share of plumes told at shares of others (n,), straight between ties."""
    levels = np.unique(np.concatenate([plume, other]))[::-1]
    told = [np.append(0.0, [np.mean(part >= level) for level in levels]) for part in (other, plume)]
    return np.interp(at, *told)


def plots(people: Population, looks: dict[str, Looks], folder: Path) -> None:
    """Draw the curves and the confusion of types."""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams["svg.hashsalt"] = "opir"
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(2, 3, figsize=(11.0, 7.4), sharex=True, sharey=True, layout="constrained")
    for row, of_looks in enumerate((False, True)):
        for axis, kind in zip(axes[row], KINDS, strict=True):
            draw_curves(axis, people, looks, kind, of_looks=of_looks)
        axes[row, 0].set_ylabel(f"share of {'looks' if of_looks else 'detections'} of plumes told so")
    axes[1, 2].legend(frameon=False, loc="lower right")
    figure.savefig(folder / "discrimination.svg", metadata={"Date": None})
    figure, axes = pyplot.subplots(1, 3, figsize=(11.0, 3.4), sharey=True, layout="constrained")
    for axis, sensor in zip(axes, SENSORS, strict=True):
        draw_confusion(axis, people, looks[sensor])
        axis.set_title(sensor)
    axes[0].set_ylabel("true type")
    figure.savefig(folder / "classification.svg", metadata={"Date": None})


def draw_curves(axis: Any, people: Population, looks: dict[str, Looks], kind: str, *, of_looks: bool) -> None:
    """Draw the curves of all sensors against a kind, with bands of resampled objects."""
    rng, at = np.random.default_rng(5), np.linspace(0.0, 1.0, 101)
    plume, other = np.isin(people.kind, TARGET_TYPES), people.kind == kind
    for sensor, colour in zip(SENSORS, ("C1", "C0", "C2"), strict=True):
        score = looks[f"{sensor}-ANY"].log_ratio
        shown = np.isfinite(score) | of_looks
        parts = score[plume & shown], score[other & shown]
        drawn = [roc(*(rng.choice(part, len(part)) for part in parts), at) for _ in range(200)]
        axis.fill_between(at, *np.quantile(drawn, [0.025, 0.975], axis=0), color=colour, alpha=0.15, linewidth=0)
        axis.plot(at, roc(*parts, at), color=colour, label=sensor)
        if of_looks:
            passed = looks[sensor].code < len(REPORTED_TYPES)
            axis.plot(passed[other].mean(), passed[plume].mean(), "x", color=colour, markersize=8)
    told = "looks" if of_looks else "detections"
    axis.set(xlabel=f"share of {told} of {kind}s told a plume", xlim=(-0.02, 1.02), ylim=(-0.02, 1.02))
    axis.grid(alpha=0.3)


def draw_confusion(axis: Any, people: Population, looks: Looks) -> None:
    """Draw what looks at launches of each type are reported as, in percent with intervals."""
    for row, kind in enumerate(TARGET_TYPES):
        codes = looks.code[people.kind == kind]
        share = np.bincount(codes, minlength=len(CODES)) / len(codes)
        axis.imshow(
            share[None], vmin=0.0, vmax=1.0, cmap="Blues", aspect="auto", extent=(-0.5, 4.5, row + 0.5, row - 0.5)
        )
        for column, value in enumerate(share.tolist()):
            low, high = interval(round(value * len(codes)), len(codes))
            told = f"{100 * value:.0f}\n{100 * low:.0f}–{100 * high:.0f}"
            ink = "white" if value > 0.6 else "black"
            axis.text(column, row, told, ha="center", va="center", fontsize=8, color=ink)
    axis.set(xlim=(-0.5, 4.5), ylim=(2.5, -0.5))
    axis.set_xticks(range(5), [code.replace(" ", "\n") for code in CODES], fontsize=8)
    axis.set_yticks(range(3), TARGET_TYPES)


def main() -> None:
    """Print the tables; with `--write`, make the page and its plots."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--launches", type=int, default=150)
    parser.add_argument("--sources", type=int, default=150)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--write", type=Path)
    arguments = parser.parse_args()
    people = population(arguments.launches, arguments.sources, arguments.seed)
    looks = looks_at(people, *simulated(people))
    area_order, type_order = order_tables(people, looks)
    page = PAGE.format(
        launches=arguments.launches,
        sources=arguments.sources,
        seed=arguments.seed,
        brightness=BRIGHTNESS,
        colour=COLOUR,
        area=AREA,
        period=PERIOD_S,
        areas=areas_table(people, looks),
        area_order=area_order,
        confusion=confusion_table(people, looks),
        type_order=type_order,
        remarks=REMARKS.rstrip(),
    )
    print(page)
    if arguments.write:
        (arguments.write / "discrimination.md").write_text(page, encoding="utf-8")
        plots(people, looks, arguments.write)


if __name__ == "__main__":
    main()
