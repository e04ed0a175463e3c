"""Plumes against fires, flares and glints, and the types of launches: one look each, through the whole engine.

    python benchmarks/discrimination.py [--launches 150] [--sources 150] [--seed 1] [--write docs/benchmarks]

Launches of each type and hot sources of each kind, drawn at random below one geostationary place, are simulated with
every sensor at that place. Of each one moment is drawn, the same for all sensors, and the look at that moment is
judged: so looks are independent, and sensors are compared in pairs. `--write` makes the page and its plots.
"""

import argparse
from itertools import pairwise
from pathlib import Path

import numpy as np
from discrimination_objects import (
    AREA,
    BRIGHTNESS,
    CODES,
    COLOUR,
    KINDS,
    PERIOD_S,
    SENSORS,
    Looks,
    Population,
    is_right,
    looks_at,
    population,
    simulated,
)
from discrimination_plots import plots
from discrimination_statistics import area, area_gain, interval, type_gain

from opir_core.scene.scene import REPORTED_TYPES, TARGET_TYPES

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
1988, 837), below at least as wide as Clopper and Pearson's for the smaller number of objects. *Of detections* is what
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
- The HEO sensor is not among them: its notional bands, noise and thresholds are those of SBIRS-GEO, so that from one
  place both tell the same.
- Gates cost detections: low in the air the ratios of bands are not those of a plume higher up, and a small plume's
  long-wave light is below the coincidence threshold. The likelihood ratio on any band's detections loses fewer of them.
"""


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
