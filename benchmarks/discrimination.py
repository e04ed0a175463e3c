"""Plumes against fires, flares and glints, and the types of launches: one look each, through the
whole engine.

    python benchmarks/discrimination.py [--launches 150] [--sources 300] [--seed 1] [--write
    docs/benchmarks]

Launches of each type and hot sources of each kind, drawn at random below one geostationary slot,
are simulated with every sensor at that slot, all settings default. For each object one time is
drawn, the same for all sensors, and the report of the last scan before it is scored: so objects are
independent, and sensors are compared in pairs. `--write` makes the page, its plots and its CSV
files.
"""

import argparse
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from discrimination_objects import (
    AREA,
    BRIGHTNESS,
    CODES,
    COLOUR,
    KINDS,
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
from work_precision.results_csv import write_csv

from opir_core.scene.scene import REPORTED_TYPES, TARGET_TYPES

#: Fewest reports of each kind for an area under the curve of reports.
ENOUGH = 20

PAGE = """# Discrimination and classification

*How well does each sensor separate plumes from fires, flares and glints, and the types of missiles from one another?*
With default settings the difference of frames takes away most of what does not move, before any classifier. Of
{others} fires, flares and glints {reported}.
{missiles}

{areas}

Of all objects of a kind, how many the sensor reports; area under the ROC curve (AUC) of the log odds of a missile, of
reports of plumes against reports of fires, and of plumes against all others where what is not reported scores below all
reports, with 95 % intervals. {area_order}

![Shares of objects that are reported, and ROC curves of plume against fire, by sensor](discrimination.svg)

Share of launches that are reported with their type (from a probability of 0.6): {type_order}

![Reported types of launches of each type, by sensor](classification.svg)

{remarks}

**Method.** {launches} launches of each type and {sources} fires, gas flares and sun glints each, seed {seed}, below one
geostationary slot by day (midlatitude summer, no cloud). Places, headings and ranges are uniform or log-uniform,
brightness log-normal with sigma {brightness} (all bands) and {colour} (each band), with any of five propellants; areas
with sigma {area}. One random moment of each object, the same for all sensors, launches within their burn: the report of
the last scan before it counts. Sensors, detection, classifier and its prior are default. AUCs have DeLong's intervals
(Biometrics 44, 1988, 837), shares those of Clopper and Pearson, their differences an exact McNemar test. Every AUC:
[discrimination.csv](discrimination.csv). Confusion of types: [classification.csv](classification.csv).
"""

REMARKS = """\
**Why.**

- A focal plane subtracts an earlier frame from each: of a source that stands still only its shift on the pixels is
  left, too little of flares and glints, enough of large fires. A plume moves on and grows.
- DSP, with light its preset `heritage`, looks every 10 s and reports from the third detection among four looks: no
  launch in the first 20 s in which it could be seen.
- From geostationary distance the range is known to about 1 %, so brightness itself separates types, as far as levels of
  plumes and what burns are known: within a type they spread over a factor of ten. The number of detections so far
  separates an ICBM late in its burn from a smaller type.
- HEO has the bands, noise and thresholds of SBIRS-GEO."""


class Area(NamedTuple):
    """AUC of plumes against a kind of source with its 95 % interval, and the numbers of objects."""

    sensor: str
    against: str
    of: str
    auc: float
    low: float
    high: float
    plumes: int
    others: int


class Confusion(NamedTuple):
    """How often looks at launches of a type are reported as another, with the 95 % interval of the
    share.
    """

    sensor: str
    true_type: str
    reported: str
    count: int
    looks: int
    share: float
    low: float
    high: float


def areas(people: Population, looks: dict[str, Looks]) -> Iterator[Area]:
    """Yield the areas of each sensor against each kind, of reports and of looks."""
    plume = np.isin(people.kind, TARGET_TYPES)
    for of_looks in (False, True):
        for sensor in SENSORS:
            score = looks[sensor].log_odds
            shown = np.isfinite(score) | of_looks
            for kind in (*KINDS, "all"):
                other = ~plume if kind == "all" else people.kind == kind
                parts = score[plume & shown], score[other & shown]
                numbers = [len(part) for part in parts]
                if of_looks or min(numbers) >= ENOUGH:
                    name = "looks" if of_looks else "reports"
                    yield Area(sensor, kind, name, *area(*parts), *numbers)


def reported(people: Population, looks: Looks, kinds: Sequence[str]) -> tuple[int, int]:
    """Return how many objects of some kinds are reported, and how many there are."""
    rows = np.isin(people.kind, kinds)
    return int(np.sum(looks.code[rows] < len(REPORTED_TYPES))), int(rows.sum())


def areas_table(people: Population, looks: dict[str, Looks], found: list[Area]) -> str:
    """Return a line for each sensor: what it reports of each kind, and areas against fires and
    against all.
    """
    names = " | ".join(f"{kind}s" for kind in KINDS)
    lines = [
        f"| sensor | plumes | {names} | AUC, reports of fires | AUC, all others |",
        "|---" * (4 + len(KINDS)) + "|",
    ]
    for sensor in SENSORS:
        cells = [
            "{} of {}".format(*reported(people, looks[sensor], kinds))
            for kinds in (TARGET_TYPES, *((kind,) for kind in KINDS))
        ]
        own = {(row.of, row.against): row for row in found if row.sensor == sensor}
        for key in (("reports", "fire"), ("looks", "all")):
            row = own.get(key)
            cells.append(f"{row.auc:.3f} ({row.low:.3f}–{row.high:.3f})" if row else "too few")
        lines.append(f"| {sensor} | {' | '.join(cells)} |")
    return "\n".join(lines)


def answer(people: Population, looks: dict[str, Looks]) -> dict[str, Any]:
    """Return the numbers of the first answer: of what is no plume, how much is reported, and as a
    missile.
    """
    counts = [reported(people, looks[sensor], KINDS) for sensor in SENSORS]
    others = np.isin(people.kind, KINDS)
    missiles = sum(
        int(np.isin(looks[sensor].code[others], range(len(TARGET_TYPES))).sum())
        for sensor in SENSORS
    )
    return {
        "others": counts[0][1],
        "reported": ", ".join(
            f"{sensor} reports {count}" for sensor, (count, _) in zip(SENSORS, counts, strict=True)
        ),
        "missiles": f"{missiles or 'None'} of these reports {'say' if missiles > 1 else 'says'}"
        " that it is a missile.",
    }


def area_orders(
    people: Population, looks: dict[str, Looks], *, of_looks: bool
) -> list[tuple[str, str, float, float, float]]:
    """Return each step of the order of sensors with gain, deviation and p."""
    plume = np.isin(people.kind, TARGET_TYPES)
    found = []
    for worse, better in pairwise(SENSORS):
        scores = [looks[sensor].log_odds for sensor in (worse, better)]
        parts = [[score[plume], score[~plume]] for score in scores]
        found.append((worse, better, *area_gain(parts[0], parts[1], of_looks=of_looks)))
    return found


def type_orders(people: Population, looks: dict[str, Looks]) -> list[tuple[str, str, float, float]]:
    """Return each step of the order of sensors with gain and p."""
    right = {sensor: is_right(looks[sensor], people.kind) for sensor in SENSORS}
    return [
        (worse, better, *type_gain(right[worse], right[better]))
        for worse, better in pairwise(SENSORS)
    ]


def confusion(people: Population, looks: dict[str, Looks]) -> Iterator[Confusion]:
    """Yield the confusion of types."""
    for sensor in SENSORS:
        for kind in TARGET_TYPES:
            codes = looks[sensor].code[people.kind == kind]
            for number, code in enumerate(CODES):
                hits = int(np.sum(codes == number))
                yield Confusion(
                    sensor,
                    kind,
                    code,
                    hits,
                    len(codes),
                    hits / len(codes),
                    *interval(hits, len(codes)),
                )


def order_tables(people: Population, looks: dict[str, Looks]) -> tuple[str, str]:
    """Return the gains of each step of the order of sensors: in AUC, and in correct types with
    their shares.
    """
    areas = "Gains: {}.".format(
        "; ".join(
            f"{worse} to {better} {gain:+.3f} (p {p:.1e})"
            for worse, better, gain, _, p in area_orders(people, looks, of_looks=True)
        )
    )
    types = []
    for sensor in SENSORS:
        right = is_right(looks[sensor], people.kind)
        seen, _ = reported(people, looks[sensor], TARGET_TYPES)
        low, high = interval(int(right.sum()), len(right))
        of_looks = f"{right.mean():.3f} ({low:.3f}–{high:.3f})"
        types.append(f"{sensor} {of_looks}, and {right.sum() / max(seen, 1):.3f} of {seen} reports")
    gains = "; ".join(
        f"{a} to {b} {gain:+.3f} (p {p:.1e})" for a, b, gain, p in type_orders(people, looks)
    )
    return areas, f"{'; '.join(types)}. Gains: {gains}."


def main() -> None:
    """Print the tables; with `--write`, make the page and its plots."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--launches", type=int, default=150)
    parser.add_argument("--sources", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--write", type=Path)
    arguments = parser.parse_args()
    people = population(arguments.launches, arguments.sources, arguments.seed)
    looks = looks_at(people, *simulated(people))
    found = list(areas(people, looks))
    area_order, type_order = order_tables(people, looks)
    page = PAGE.format(
        launches=arguments.launches,
        sources=arguments.sources,
        seed=arguments.seed,
        brightness=BRIGHTNESS,
        colour=COLOUR,
        area=AREA,
        areas=areas_table(people, looks, found),
        **answer(people, looks),
        area_order=area_order,
        type_order=type_order,
        remarks=REMARKS,
    )
    print(page)
    if arguments.write:
        (arguments.write / "discrimination.md").write_text(page, encoding="utf-8")
        write_csv(arguments.write / "discrimination.csv", found)
        write_csv(arguments.write / "classification.csv", list(confusion(people, looks)))
        plots(people, looks, arguments.write)


if __name__ == "__main__":
    main()
