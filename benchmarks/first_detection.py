"""First detections: by class, sensor, climate and cloud, from the engine and from every look's
probability.

A launch of each class is repeated many times, each time with random numbers of its own, in one run
of the engine. The distribution of the first report is compared with the one that follows exactly
from the probabilities of the looks and from the confirmation over scans. Where the two differ by
too much, the script fails. The exact distribution is computed once more with each cause of a delay
switched off by itself.
"""

from typing import Any, NamedTuple

import numpy as np
from pages import markdown_table, options_of, publish, svg_plot

import opir_core as opir
from opir_core.geometry import ecef_to_geodetic
from opir_core.interfaces.radiometric_models import AtmosphereContext, Paths
from opir_core.planning.looks import Looks
from opir_core.plugin import Band

CLIMATES = ("us1976", "tropical", "midlat_summer", "midlat_winter", "subarctic_winter")
CLOUDS: dict[str, dict[str, Any] | None] = {
    "clear sky": None,
    "cloud to 10 km": {"top_km": 10.0},
    "half covered to 6 km": {"top_km": 6.0, "cover": 0.5, "cell_km": 100.0},
}
SENSORS = {"DSP": -95.0, "SBIRS-GEO": -105.0, "NEXTGEN-GEO": -115.0}
#: Aim points of launches from 35° N, 110° W by class, degrees.
AIMS = {"SRBM": (38.0, -108.0), "IRBM": (50.0, -85.0), "ICBM": (60.0, 60.0)}
#: Heights for which transmittances are listed.
HEIGHTS_KM = (0.0, 1.0, 2.0, 4.0, 6.0, 10.0)
BANDS = (Band("SWIR", 2.5, 3.0), Band("MWIR", 4.0, 5.0), Band("LWIR", 8.0, 12.0))
IGNITION_S = 2.0
#: Confidence of all comparisons together.
CONFIDENCE = 0.999
#: Causes of delays: changes of the scene, and of the sensors, that switch each off.
CAUSES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "no air": ({"atmosphere": "clear"}, {}),
    "no background": ({"background": "none"}, {}),
    "presets paper": ({}, {"preset": "paper"}),
    "no confirmation": ({}, {"confirmation_detections": 1}),
}

PAGE = """# First detections

*When, and at what height, is a launch of each class first reported?* One launch of each class at
35° N, 110° W, seen from the geostationary slots {slots}. Plumes and sensor noise are notional.

{headline}

Entries are medians under a clear sky of the launches that are reported during their burn: time
after ignition and height, as ranges over five climates. DSP, with light its preset `heritage`,
reports {faint} % of the SRBM: a look every 10 s, of which three of four are needed, so times come
in steps of 10 s after the start that is drawn once a run.

![Median height of the first report by class, sensor and sky](first_detection.svg)

NEXTGEN-GEO reports every class first, then SBIRS-GEO, then DSP. What delays a first report, each
cause switched off by itself under a clear sky, as `atmosphere: clear` and `background: none` do:

- **Cloud.** No plume is detected below a deck: with one up to 10 km the others are reported from
  there; {cloudy} % of the SRBM by DSP. Half cover is drawn once in a run.
- **Air.** Water vapour absorbs SWIR: its transmittance from sea level is {swir}. Without air
  SBIRS-GEO reports an SRBM after {swir_delay}. What is seen near the ground is soot in the wings
  of MWIR, a level that holds within a factor of 3.
- **Background.** It matters in long waves; without it DSP, which has none, reports an IRBM after
  {lwir_delay}.
- **The paper's presets** (`preset: paper`). Their rules make every band a veto, and DSP's
  long-wave band reports practically none; an SRBM is reported by NEXTGEN-GEO after {paper_delay}.
  Ratio gates allow for a factor of {mwir_over_swir} in MWIR/SWIR that air makes
  ([detection](../explanation/detection.md#rules-over-bands)).
- **Confirmation**, two detections in three looks, costs a scan or two of a bright plume; without
  it (`confirmation_detections: 1`) DSP reports an ICBM after {confirmed_delay}.

`detection: snr`, `atmosphere: lowtran`, `background: earth` by day, all else by default. Each of
the {cases} cases has {launches} launches; times are distributed as computed exactly from the
probabilities of all looks: the largest difference is {worst_difference_over_bound:.2f} of the
bound of Dvoretzky, Kiefer, Wolfowitz and Massart at {confidence:g} for all cases together. All
cases and causes: [first_detection.csv](first_detection.csv); transmittances:
[first_detection_air.csv](first_detection_air.csv).
"""


class Law(NamedTuple):
    """Looks (n,) of one sensor at one launch: times when light left, s, heights, m, and the
    probability that each is reported first.
    """

    emission_s: np.ndarray
    height_m: np.ndarray
    first: np.ndarray

    def median(self):
        """Return time after ignition and height of the median first detection, and the share
        detected.
        """
        share = float(self.first.sum())
        if share <= 0.0:
            return {"time_s": np.nan, "height_km": np.nan, "share": share}
        middle = int(np.searchsorted(np.cumsum(self.first), 0.5 * share))
        time_s = float(self.emission_s[middle] - IGNITION_S)
        return {"time_s": time_s, "height_km": float(self.height_m[middle] / 1e3), "share": share}


NO_LOOK = Law(np.zeros(0), np.zeros(0), np.zeros(0))


def scene(
    climate,
    cloud,
    targets,
    exact,
    settings=None,
    **changes,
):
    """Return a scene with each launch repeated; `settings` are those of all sensors, `changes` of
    the scene.
    """
    deck = {} if CLOUDS[cloud] is None else {"cloud": CLOUDS[cloud]}
    launch = {"lat_deg": 35.0, "lon_deg": -110.0, "time_s": IGNITION_S}
    return opir.scene_from_mapping(
        {
            "scene": "first-detection",
            "epoch": "2026-04-01T19:00:00Z",
            "duration_s": 200.0,
            "seed": 11,
            "sensors": [
                {"model": model, "id": model, "orbital_slot_deg": slot_deg, **(settings or {})}
                for model, slot_deg in SENSORS.items()
            ],
            "targets": [
                {
                    "id": f"{kind}-{number}",
                    "type": kind,
                    "launch": launch,
                    "aim": {"lat_deg": lat_deg, "lon_deg": lon_deg},
                }
                for kind, (lat_deg, lon_deg) in AIMS.items()
                for number in range(targets)
            ],
            "detection": {"model": "snr", "exact": exact},
            "atmosphere": {"model": "lowtran", "climate": climate, **deck},
            "background": "earth",
            "outputs": [],
            **changes,
        }
    )


def laws(exact_scene):
    """Return the law of the first report by sensor and target, from every look's probability."""
    plan = opir.compile_plan(exact_scene)
    looks = Looks.between(plan.pairs, 0, plan.end_ns)
    exposed = plan.look_geometry().exposures(looks.pair, looks.scan)
    probability = plan.detection.probability(exposed)
    by_pair = {}
    for pair in np.unique(looks.pair).tolist():
        rows = np.flatnonzero(looks.pair == pair)
        sensor = int(plan.pairs.sensor[pair])
        confirmation = plan.sensors[sensor].radiometer.confirmation
        height_m = ecef_to_geodetic(exposed.target_ecef_m[rows]).height_m
        first = first_reports(probability[rows], *confirmation)
        key = (sensor, int(plan.pairs.target[pair]))
        by_pair[key] = Law(exposed.emission_time_s[rows], height_m, first)
    return by_pair


def first_reports(probability, needed, scans):
    """Return the probabilities (n,) that looks with P_d (n,) are reported first: the M-th detection
    among N looks.

    States are which of the last N - 1 looks detected, as bits, before any report.
    """
    states = np.arange(1 << (scans - 1))
    hits = np.array([state.bit_count() for state in states.tolist()])
    missed = (states << 1) & (len(states) - 1)
    detected = missed | (1 if scans > 1 else 0)
    reports = hits >= needed - 1
    weight = (states == 0).astype(np.float64)
    first = np.zeros(len(probability))
    for look, p in enumerate(probability.tolist()):
        first[look] = p * weight[reports].sum()
        silent = np.where(reports, 0.0, p * weight)
        weight = np.bincount(missed, weight * (1.0 - p), len(states)) + np.bincount(
            detected, silent, len(states)
        )
    return first


def first_times(plan):
    """Return when the light of first reports left (sensors, targets), s; inf without one."""
    first_s = np.full((len(plan.sensors), len(plan.targets.ids)), np.inf)
    engine = opir.Engine(plan)
    step_ns = 5 * 10**9
    for end_ns in range(step_ns, plan.end_ns + step_ns, step_ns):
        window = engine.advance(min(end_ns, plan.end_ns))
        real = window.truth.target >= 0
        pair = window.detections.sensor[real], window.truth.target[real]
        np.minimum.at(first_s, pair, window.truth.emission_time_s[real])
    return first_s


def sky_rows(climate, cloud, targets, comparisons):
    """Yield the results of all classes and sensors under one sky."""
    by_pair = laws(scene(climate, cloud, 1, exact=True))
    first_s = first_times(opir.compile_plan(scene(climate, cloud, targets, exact=False)))
    bound = np.sqrt(np.log(2.0 * comparisons / (1.0 - CONFIDENCE)) / (2.0 * targets))
    for number, kind in enumerate(AIMS):
        for sensor, name in enumerate(SENSORS):
            law = by_pair.get((sensor, number), NO_LOOK)
            times_s = first_s[sensor, number * targets : (number + 1) * targets]
            seen_s = np.sort(times_s[np.isfinite(times_s)])
            counts = np.searchsorted(seen_s, law.emission_s + 1e-6)
            difference = np.abs(counts / targets - np.cumsum(law.first))
            largest = difference.max() if len(difference) else len(seen_s) / targets
            sky = {"kind": kind, "sensor": name, "climate": climate, "cloud": cloud}
            yield {**sky, **law.median(), "ratio": float(largest / bound)}


def cause_rows(cause, climate):
    """Yield the cases with a cause of delays switched off under a clear sky, from the exact
    distribution.
    """
    changes, settings = CAUSES[cause]
    by_pair = laws(scene(climate, "clear sky", 1, exact=True, settings=settings, **changes))
    for number, kind in enumerate(AIMS):
        for sensor, name in enumerate(SENSORS):
            law = by_pair.get((sensor, number), NO_LOOK)
            sky = {"kind": kind, "sensor": name, "climate": climate, "cloud": cause}
            yield {**sky, **law.median(), "ratio": 0.0}


def rows_of(climates, targets, facts):
    """Yield all cases; raise `SystemExit` if the engine differs from the exact distribution."""
    comparisons = len(climates) * len(CLOUDS) * len(AIMS) * len(SENSORS)
    rows = [
        row
        for cloud in CLOUDS
        for climate in climates
        for row in sky_rows(climate, cloud, targets, comparisons)
    ]
    worst = max(row["ratio"] for row in rows)
    facts |= {"cases": comparisons, "launches": targets, "worst_difference_over_bound": worst}
    if worst > 1.0:
        raise SystemExit(
            "the engine's first reports do not follow from the probabilities of their looks"
        )
    yield from rows
    for cause in CAUSES:
        for climate in climates:
            yield from cause_rows(cause, climate)


def air_rows(climates):
    """Yield the transmittances of the three bands from several heights to space."""
    lowtran = opir.Host.discover().component("opir_atmosphere_models", "lowtran")
    context = AtmosphereContext(bands=BANDS, path="atmosphere", seed=0)
    blank = np.zeros((len(HEIGHTS_KM), 3))
    # SBIRS-GEO and NEXTGEN-GEO stand 49° above the launch site.
    sine = np.full(len(blank), np.sin(np.radians(49.0)))
    paths = Paths(1e3 * np.array(HEIGHTS_KM), sine, blank, blank, blank[:, 0])
    for climate in climates:
        sky = lowtran.build(lowtran.config(climate=climate), context)
        bands = [sky.transmittance(number, paths).tolist() for number in range(len(BANDS))]
        for height_km, swir, mwir, lwir in zip(HEIGHTS_KM, *bands, strict=True):
            row = {"climate": climate, "height_km": height_km}
            yield {**row, "swir": swir, "mwir": mwir, "lwir": lwir}


def between(values, short=0.0):
    """Return the range of values, with a digit after the point below `short`."""
    low, high = (f"{value:.{1 if value < short else 0}f}" for value in (min(values), max(values)))
    return low if low == high else f"{low}–{high}"


def spread(table, **cells):
    """Return the ranges of times and heights of some cases."""
    rows = table.where(**cells)
    time_s = between(rows.column("time_s"), 9.95)
    return f"{time_s} s", f"{between(rows.column('height_km'), 1e3)} km"


def delay(table, kind, sensor, cause):
    """Return the times without a cause and by default."""
    case = {"kind": kind, "sensor": sensor}
    without, _ = spread(table, **case, cloud=cause)
    default, _ = spread(table, **case, cloud="clear sky")
    return f"{without} instead of {default}"


def percent(table, cloud):
    """Return the range of the shares of SRBM launches that DSP detects, in percent."""
    shares = table.where(kind="SRBM", sensor="DSP", cloud=cloud).column("share")
    return between([100.0 * share for share in shares])


def page(table, air):
    """Return the page."""
    ground = air.where(height_km=0)
    swir = ground.column("swir")
    ratios = [row["mwir"] / row["swir"] for row in ground]
    lines = [
        (
            kind,
            *(
                ", ".join(spread(table, kind=kind, sensor=sensor, cloud="clear sky"))
                for sensor in SENSORS
            ),
        )
        for kind in AIMS
    ]
    return PAGE.format(
        slots=", ".join(f"{-slot:g}° W ({name})" for name, slot in SENSORS.items()),
        headline=markdown_table(("class", *SENSORS), lines),
        faint=percent(table, "clear sky"),
        cloudy=percent(table, "cloud to 10 km"),
        swir_delay=delay(table, "SRBM", "SBIRS-GEO", "no air"),
        lwir_delay=delay(table, "IRBM", "DSP", "no background"),
        paper_delay=delay(table, "SRBM", "NEXTGEN-GEO", "presets paper"),
        confirmed_delay=delay(table, "ICBM", "DSP", "no confirmation"),
        mwir_over_swir=f"{min(ratios):.0f} to {max(ratios):.0f}",
        swir=f"{min(swir):.3f} to {max(swir):.2f}",
        confidence=CONFIDENCE,
        **table.facts,
    )


def draw(path, table):
    """Draw heights of the first report: a panel for each kind of cloud and without air, a mark for
    each climate.
    """
    labels = [f"{kind} {sensor}" for kind in AIMS for sensor in SENSORS]
    skies = (*CLOUDS, "no air")
    with svg_plot(path, 1, len(skies), figsize=(12, 4), sharey=True) as (_, axes):
        for panel, sky in zip(axes, skies, strict=True):
            for number, climate in enumerate(table.names("climate")):
                rows = [
                    row for row in table.where(cloud=sky, climate=climate) if row["share"] >= 0.01
                ]
                places = [labels.index(f"{row['kind']} {row['sensor']}") for row in rows]
                shifted = [place + 0.12 * (number - 2) for place in places]
                panel.plot(shifted, [row["height_km"] for row in rows], ".", label=climate)
            panel.set(title=sky, yscale="symlog")
            panel.set_xticks(range(len(labels)), labels, rotation=90, fontsize=7)
        axes[0].set_ylabel("median height of the first report, km")


def main():
    """Run all skies and write."""
    options = options_of(__doc__, targets=200, climates=len(CLIMATES))
    climates = CLIMATES[: options.climates]
    facts = {}
    publish(
        options,
        page,
        draw,
        facts,
        first_detection=rows_of(climates, options.targets, facts),
        first_detection_air=air_rows(climates),
    )


if __name__ == "__main__":
    main()
