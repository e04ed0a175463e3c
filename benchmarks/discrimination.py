"""Plumes against fires, flares and glints, and the types of launches: one look each, through the
whole engine.

    python benchmarks/discrimination.py [--launches 150] [--sources 150] [--seed 1] [--write
    docs/benchmarks]

Launches of each type and hot sources of each kind, drawn at random below one geostationary slot,
are simulated with every sensor at that slot. For each object one time is drawn, the same for all
sensors, and the look at that time is scored: so looks are independent, and sensors are compared in
pairs. `--write` makes the page, its plots and its CSV files.
"""

import argparse
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

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
from work_precision.results_csv import write_csv

from opir_core.scene.scene import REPORTED_TYPES, TARGET_TYPES

PAGE = """# Discrimination and classification

*How well does each sensor separate plumes from fires, flares and glints, and the types of missiles from one another?*
DSP worst, NEXTGEN-GEO best. This follows from bands and noise, which are notional: a sensor has no setting for how
well it discriminates.

![ROC curves of plume against fire, flare and glint, by sensor, with 95 % bands](discrimination.svg)

Area under the ROC curve (AUC) of the log odds of a missile by `classification: spectral`, of objects that the sensor
detects with any band (`spectral_discrimination: none`), and of all looks, with 95 % intervals:

{areas}

A look that does not detect scores below all others. Crosses in the plot: the sensors' own rules. {area_order}

![Reported types of looks at launches of each type, by sensor](classification.svg)

Share of the looks, one at each launch, that report its type correctly (from a probability of 0.6): {type_order}

{remarks}

**Method.** {launches} launches of each type and {sources} fires, gas flares and sun glints each, seed {seed}, below one
geostationary slot by day (midlatitude summer, no cloud). Places, headings and ranges are uniform or log-uniform,
brightness log-normal with sigma {brightness} (all bands) and {colour} (each band), with any of five propellants; areas
with sigma {area}. DSP has preset `paper`. One look at each object at a random time, the same for all sensors; the
revisit interval is {period:g} s. Noise is given, 5·10⁻¹³, 10⁻¹² and 10⁻¹³ W/m², without focal planes: with those of the
default sensors the difference of frames takes away nearly all fires, flares and glints before any classifier, and DSP,
in long waves, sees no plume before the Earth. The classifier's prior is that of the scene. AUCs have DeLong's intervals
(Biometrics 44, 1988, 837), shares those of
Clopper and Pearson, their differences an exact McNemar test. Every AUC: [discrimination.csv](discrimination.csv).
Confusion of types: [classification.csv](classification.csv).
"""

REMARKS = """\
**Why.**

- From geostationary distance the range is known to about 1 %, so brightness itself separates types, as far as levels of
  plumes and what burns are known: within a type they spread over a factor of ten. The number of detections so far
  separates an ICBM late in its burn from a smaller type.
- DSP has one band. It separates fires, whose LWIR is far above that of plumes, but not a flare or a glint as bright as
  a plume, and hardly separates types.
- The second band of SBIRS-GEO gives a colour; the third band of NEXTGEN-GEO and its lower noise the spectrum. HEO
  has the bands, noise and thresholds of SBIRS-GEO."""


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
    """Yield the areas of each sensor against each kind, of detections and of looks."""
    plume = np.isin(people.kind, TARGET_TYPES)
    for of_looks in (False, True):
        for sensor in SENSORS:
            score = looks[f"{sensor}-ANY"].log_odds
            shown = np.isfinite(score) | of_looks
            for kind in (*KINDS, "all"):
                other = ~plume if kind == "all" else people.kind == kind
                parts = score[plume & shown], score[other & shown]
                name = "looks" if of_looks else "detections"
                yield Area(sensor, kind, name, *area(*parts), len(parts[0]), len(parts[1]))


def areas_table(found: list[Area]) -> str:
    """Return a line for each sensor: detections against each kind, and detections and looks against
    all.
    """
    lines = [
        f"| sensor | {' | '.join(KINDS)} | all | all, looks |",
        "|---" * (3 + len(KINDS)) + "|",
    ]
    for sensor in SENSORS:
        own = {(row.of, row.against): row for row in found if row.sensor == sensor}
        cells = [f"{own['detections', kind].auc:.3f}" for kind in KINDS]
        both = own["detections", "all"], own["looks", "all"]
        cells += [f"{row.auc:.3f} ({row.low:.3f}–{row.high:.3f})" for row in both]
        lines.append(f"| {sensor} | {' | '.join(cells)} |")
    return "\n".join(lines)


def area_orders(
    people: Population, looks: dict[str, Looks], *, of_looks: bool
) -> list[tuple[str, str, float, float, float]]:
    """Return each step of the order of sensors with gain, deviation and p."""
    plume = np.isin(people.kind, TARGET_TYPES)
    found = []
    for worse, better in pairwise(SENSORS):
        scores = [looks[f"{sensor}-ANY"].log_odds for sensor in (worse, better)]
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
    steps = [
        step for of_looks in (False, True) for step in area_orders(people, looks, of_looks=of_looks)
    ]
    least = min(gain for *_, gain, _sigma, _p in steps)
    worst_p = max(p for *_, p in steps)
    areas = (
        f"Each step of the order gains {least:+.3f} or more against all kinds (largest one-sided p"
        f" {worst_p:.1e})."
    )
    types = []
    for sensor in SENSORS:
        right = is_right(looks[sensor], people.kind)
        seen = int(
            np.sum(looks[sensor].code[np.isin(people.kind, TARGET_TYPES)] < len(REPORTED_TYPES))
        )
        low, high = interval(int(right.sum()), len(right))
        of_looks = f"{right.mean():.3f} ({low:.3f}–{high:.3f})"
        types.append(
            f"{sensor} {of_looks}, and {right.sum() / max(seen, 1):.3f} of {seen} detections"
        )
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
    parser.add_argument("--sources", type=int, default=150)
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
        period=PERIOD_S,
        areas=areas_table(found),
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
