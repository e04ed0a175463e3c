"""The sections of a run's report: each makes its figures, or None where the run has nothing to
show.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from opir_core import Scene
from opir_core.cli import grouped, source_table, track_table
from opir_core.scene import Choice
from opir_report.canvas import WIDTH_IN, svg_of
from opir_report.figure_data import FigureData
from opir_report.pages.page import ReportFigure, ReportSection, ReportTable
from opir_report.plots.confidence import confidence_plot, confidences
from opir_report.plots.consistency import containment_plot, nees_history, nees_plot, region_history
from opir_report.plots.delays import delay_plot, report_delays
from opir_report.plots.directing import direction_plot, directions, directions_height_in
from opir_report.plots.flights import fields_of_view, view_time_s
from opir_report.plots.footprints import footprint_map, footprints
from opir_report.plots.hypotheses import hypotheses_plot, hypothesis_history, weighed_tracks
from opir_report.plots.impact import impact_map, impact_points
from opir_report.plots.latency import latency_curves, latency_plot, pair_latencies
from opir_report.plots.modes import modes_over_time, modes_plot
from opir_report.plots.scores import score_rows
from opir_report.plots.signal import PANELS, signal_plot, signals
from opir_report.plots.timeline import detection_counts, timeline
from opir_report.run_plots import MAP_IN, WORLD_IN, RunPlots, timeline_height_in

_LAUNCHES = (
    "True ground tracks, thick while the target burns; the last predicted impact points with the"
    " regions that contain the impact with 95 %. Azimuthal equidistant projection about the"
    " launches."
)
_SATELLITES = (
    "Dashed is the edge of the ground that each can see, a spherical cap. Moving satellites have"
    " their ground track over the run."
)
_DETECTIONS = (
    "Detections over scene time, one row per sensor with its own scale; bars on top are the burns."
)
_DIRECTING = (
    "Where the director pointed each narrow field: the target of the track that it followed, or a"
    " place. Thin is the turn, in which the field looks nowhere."
)
_MODES = (
    "The mode of each sensor that has some, and why: the target of the track that it follows and"
    " the reason of the command, where they fit. Thin is the change, in which it makes no look;"
    " nothing is drawn while it is down."
)
_FOOTPRINTS = (
    "Where narrow fields looked on the ground, at the first and the last command for one track, or"
    " for one reason: their edges, as far as the limb. Fields whose axis passes the Earth are not"
    " drawn."
)
_SIGNAL = (
    "What a look would measure along the boost, for each sensor while it sees the target: the"
    " expected signal-to-noise ratio and the transmittance of the air in the sensor's reference"
    " band, and the probability of detection."
)
_LATENCY = (
    "Share of the pairs of sensor and launch with a detection after at most that time. Dashed is"
    " the closed form, the mean over the same pairs: for a constant P_d that of a scan of random or"
    " aligned phase, else the product over the scheduled looks. Pairs that see the launch only"
    " later are left out."
)
_DELAYS = (
    "Time from looks to their reports: the median of each sensor's reports, and a band up to the"
    " delay that 95 % do not exceed. It has the latencies of reporting, queues, and waits for"
    " contacts."
)
_CONFIDENCE = (
    "Confidence of detections by target or type, with the track's probability of its likeliest"
    " type."
)
_HYPOTHESES = (
    "What the tracker holds possible, tick by tick: the probability of each hypothesis that ever"
    " reaches 1 %. First the launches, then other hot sources."
)
_CONTAINMENT = (
    "Area of the region that contains the impact with 95 %, tick by tick: filled where the true"
    " impact is inside. Estimates of one target are dependent, so the shares in the title have no"
    " interval."
)
_NEES = (
    "Normalised estimation error squared of the state, divided by its 6 degrees of freedom: 1 is"
    " consistent. Shaded is where 99 % of single samples of a consistent filter lie."
)
_MANIFEST = (
    "The manifest beside the events holds the whole scene: enough to repeat the run byte for byte."
)
_MODE_FIELDS = ("sensor_id", "mode", "half_angle_deg", "looked_s")
_SPAN_TIMES = ("start_s", "from_s", "until_s")


def figure_of(
    name: str,
    draw: Callable[[Figure], object],
    height_in: float,
    alt: str,
    caption: str = "",
    data: FigureData | None = None,
) -> ReportFigure:
    """Return a figure of a name and a height; `alt` is the text for readers who do not see it, and
    the caption if there is no other.
    """
    svg = svg_of(draw, (WIDTH_IN, height_in), name, alt)
    return ReportFigure(name, svg, caption or alt, data, draw, height_in)


def plot_of(
    name: str,
    draw: Callable[[Axes], object],
    height_in: float,
    alt: str,
    caption: str = "",
    data: FigureData | None = None,
) -> ReportFigure:
    """Return a figure of one plot, as `figure_of` does."""
    return figure_of(name, lambda figure: draw(figure.add_subplot()), height_in, alt, caption, data)


def map_section(plots: RunPlots) -> ReportSection:
    """Return the maps."""
    run = plots.facts.run
    launches = plot_of(
        "launches",
        plots.map,
        MAP_IN,
        f"Map of {len(plots.facts.ids)} launches with ground tracks, impacts and predicted impact"
        " regions",
        _LAUNCHES,
        plots.ground_tracks,
    )
    satellites = plot_of(
        "satellites",
        plots.world,
        WORLD_IN,
        f"World map of {len(run.sensors)} sensors with the edges of their fields of view",
        f"Sensors at {view_time_s(run.plan):g} s. {_SATELLITES}",
        fields_of_view(run.plan),
    )
    return ReportSection("map", "Where", "", (launches, satellites))


def detection_section(plots: RunPlots) -> ReportSection:
    """Return the timeline and the table of sensors."""
    counts = detection_counts(plots.facts)
    lines = plot_of(
        "detections",
        lambda axes: timeline(axes, plots.facts, counts),
        timeline_height_in(counts),
        "Detections of each sensor over time, by target",
        _DETECTIONS,
        counts,
    )
    tables = _sensor_tables(plots.facts.run.summary["sensors"])
    return ReportSection("detections", "What each sensor detected", "", (lines, *tables))


def _sensor_tables(rows: Sequence[Mapping[str, Any]]) -> Iterator[ReportTable]:
    """Yield the counts of the sensors, and their calibration if the tracker estimates it."""
    names = ("looks", "detections", "noise_detections", "targets_detected")
    head = ("sensor", "type", "looks", "detections", "false alarms", "targets")
    cells = [
        (row["sensor_id"], row["sensor_type"], *(grouped(row[name]) for name in names))
        for row in rows
    ]
    yield ReportTable("Sensors", head, cells)
    texts = [(row["sensor_id"], row["health"]["text"]) for row in rows if row["health"]]
    if texts:
        yield ReportTable("What the tracker found of them", ("sensor", "found"), texts)


def directing_section(plots: RunPlots) -> ReportSection | None:
    """Return where narrow fields were pointed and why, and the refused commands, if the scene has a
    director.
    """
    facts = plots.facts
    spans = directions(facts)
    contents: list[ReportFigure | ReportTable] = []
    if len(spans):
        plot = plot_of(
            "directing",
            lambda axes: direction_plot(axes, facts, spans),
            directions_height_in(spans),
            "Targets at which narrow fields were pointed over time",
            _DIRECTING,
            spans,
        )
        contents.append(plot)
    contents += _mode_parts(plots)
    contents += _footprint_parts(plots)
    columns = [spans[name].tolist() for name in ("sensor_id", "target_id", "reason")]
    times = [[f"{time:.1f}" for time in spans[name].tolist()] for name in _SPAN_TIMES]
    head = ("sensor", "target", "why", "turns at s", "looks from s", "to s", "commands")
    rows = list(zip(*columns, *times, spans["commands"].astype(str).tolist(), strict=True))
    contents += _table_of("Who was sent where, and why", head, rows)
    refusals = Counter(
        (record.sensor, record.refusal) for record in facts.run.commands if record.refusal
    )
    rows = [(*key, grouped(count)) for key, count in refusals.most_common()]
    contents += _table_of("Refused commands", ("sensor", "refusal", "commands"), rows)
    return ReportSection("directing", "Who was sent where", "", contents) if contents else None


def _mode_parts(plots: RunPlots) -> Iterator[ReportFigure | ReportTable]:
    """Yield the modes of sensors over time, with the fields of each, if a command named one."""
    spans = modes_over_time(plots.facts)
    if not len(spans):
        return
    yield plot_of(
        "modes",
        lambda axes: modes_plot(axes, plots.facts, spans),
        directions_height_in(spans),
        "Modes of sensors over time, with the reasons of commands",
        _MODES,
        spans,
    )
    fields = zip(*(spans[name].tolist() for name in _MODE_FIELDS), strict=True)
    looked_s = Counter[tuple[str, str, float]]()
    for sensor, mode, half_angle_deg, span_s in fields:
        looked_s[sensor, mode, half_angle_deg] += span_s
    rows = [
        (sensor, mode, f"{angle_deg:.3g}", f"{seconds:.1f}")
        for (sensor, mode, angle_deg), seconds in looked_s.items()
    ]
    yield from _table_of("Modes", ("sensor", "mode", "half angle °", "looks s"), rows)


def _footprint_parts(plots: RunPlots) -> Iterator[ReportFigure]:
    """Yield the map of narrow fields, if one looked at the ground."""
    places = footprints(plots.facts)
    if len(places):
        yield plot_of(
            "footprints",
            lambda axes: footprint_map(axes, plots.facts, plots.ground_tracks),
            MAP_IN,
            "Narrow fields on the ground",
            _FOOTPRINTS,
            places,
        )


def signal_section(plots: RunPlots) -> ReportSection | None:
    """Return SNR, P_d and air along the boost of the first two launches, if the detection model has
    a signal.
    """
    facts = plots.facts
    data = {target: signals(facts, target) for target in range(min(facts.launches, 2))}
    figures = [
        _signal_figure(plots, target, looks)
        for target, looks in data.items()
        if len(looks) and np.isfinite(looks["snr"]).any()
    ]
    if not figures:
        return None
    count = len(figures)
    omission = f" The first {count} of {facts.launches} launches." if facts.launches > count else ""
    return ReportSection("signal", "Signal, probability and air", _SIGNAL + omission, figures)


def _signal_figure(plots: RunPlots, target: int, data: FigureData) -> ReportFigure:
    def draw(figure: Figure) -> None:
        for place, panel in enumerate(PANELS, start=1):
            axes = signal_plot(
                figure.add_subplot(len(PANELS), 1, place), plots.facts, target, data, panel
            )
            if place > 1:
                axes.set_title("")
            legend = axes.get_legend()
            if place > 1 and legend is not None:
                legend.remove()

    name = plots.facts.ids[target]
    alt = (
        f"Expected SNR, probability of detection and transmittance along the boost of {name}, by"
        " sensor"
    )
    return figure_of(f"signal-{target + 1}", draw, 7.2, alt, f"{name} along its boost.", data)


def latency_section(plots: RunPlots) -> ReportSection | None:
    """Return the distribution of latencies against the closed form."""
    pairs = pair_latencies(plots.facts)
    if not pairs:
        return None
    data = latency_curves(pairs)
    plot = plot_of(
        "latency",
        lambda axes: latency_plot(axes, plots.facts, pairs, data),
        3.9,
        "Distribution of the latency to the first detection by sensor type, against the closed"
        " form",
        _LATENCY,
        data,
    )
    return ReportSection("latency", "How soon", "", (plot,))


def delay_section(plots: RunPlots) -> ReportSection | None:
    """Return the delays of reports."""
    data = report_delays(plots.facts)
    if not len(data):
        return None
    plot = plot_of(
        "delays",
        lambda axes: delay_plot(axes, plots.facts, data),
        3.7,
        "Time from looks to their reports over time, by sensor",
        _DELAYS,
        data,
    )
    return ReportSection("delays", "When reports arrive", "", (plot, *_way_tables(plots)))


def _way_tables(plots: RunPlots) -> Iterator[ReportTable]:
    """Yield how many reports of each sensor took each way, and how many were lost, with links."""
    run = plots.facts.run
    paths = run.plan.link_paths
    if not paths:
        return
    sensor_paths = np.stack([run.detections.sensor, run.detections.path[:, 0]], axis=1)
    ways, counts = np.unique(sensor_paths, axis=0, return_counts=True)
    cells = [
        (run.sensors[sensor].id, " > ".join(paths[path]) if path >= 0 else "-", grouped(count))
        for (sensor, path), count in zip(ways.tolist(), counts.tolist(), strict=True)
    ]
    if run.lost is not None:
        lost = zip(run.sensors, run.lost.tolist(), strict=True)
        cells += [(sensor.id, "lost", grouped(count)) for sensor, count in lost if count]
    yield ReportTable("Ways of reports", ("sensor", "by", "reports"), cells)


def confidence_section(plots: RunPlots) -> ReportSection | None:
    """Return the confidence over time."""
    data = confidences(plots.facts)
    if not len(data):
        return None
    plot = plot_of(
        "confidence",
        lambda axes: confidence_plot(axes, plots.facts, data),
        3.7,
        "Confidence of detections over time since ignition, and type probability of the tracks",
        _CONFIDENCE,
        data,
    )
    return ReportSection("confidence", "How sure", "", (plot,))


def identity_section(plots: RunPlots) -> ReportSection | None:
    """Return the hypotheses of tracks, and the other hot sources, if the tracker weighs hypotheses
    or there are sources.
    """
    facts = plots.facts
    parts: list[ReportFigure | ReportTable] = []
    data = hypothesis_history(facts)
    tracks = weighed_tracks(facts)
    if len(data):

        def draw(figure: Figure) -> None:
            for place, track in enumerate(tracks, start=1):
                hypotheses_plot(figure.add_subplot(len(tracks), 1, place), facts, data, track)

        alt = f"Probability of each hypothesis over time of the tracks of {', '.join(tracks.values())}"
        parts.append(figure_of("hypotheses", draw, 2.6 * len(tracks), alt, _HYPOTHESES, data))
        parts += _table_of("Tracks", *track_table(facts.run.summary))
    parts += _table_of("Other hot sources", *source_table(facts.run.summary))
    return ReportSection("identity", "What they are", "", parts) if parts else None


def _table_of(
    caption: str, head: Sequence[str], rows: Sequence[Sequence[str]]
) -> list[ReportFigure | ReportTable]:
    """Return a table of up to 20 rows, if there are any."""
    omission = f", the first 20 of {len(rows)}" if len(rows) > 20 else ""
    return [ReportTable(f"{caption}{omission}", head, rows[:20])] if rows else []


def impact_section(plots: RunPlots) -> ReportSection | None:
    """Return the predicted impact regions: maps of the last ones, areas and containment over
    time.
    """
    facts = plots.facts
    if not facts.last_with_impact:
        return None
    history = region_history(facts)
    areas = plot_of(
        "regions",
        lambda axes: containment_plot(axes, facts, history),
        4.0,
        "Area of the 95 % impact regions over time, and whether they contain the true impact",
        _CONTAINMENT,
        history,
    )
    return ReportSection("impacts", "Where they will come down", "", (_impact_maps(plots), areas))


def _impact_maps(plots: RunPlots) -> ReportFigure:
    """Return the maps of the impacts of the first six targets."""
    facts = plots.facts
    targets = list(facts.last_with_impact)[:6]
    columns = min(len(targets), 2)
    rows = -(-len(targets) // columns)

    def draw(figure: Figure) -> None:
        for place, target in enumerate(targets, start=1):
            impact_map(figure.add_subplot(rows, columns, place), facts, target)

    total = len(facts.last_with_impact)
    omission = f" The first {len(targets)} of {total}." if total > len(targets) else ""
    names = ", ".join(facts.ids[target] for target in targets)
    return figure_of(
        "impacts",
        draw,
        (4.4 if columns == 2 else 5.6) * rows,
        f"Predicted impact regions of {names} against the true impacts",
        "The last predicted regions that contain the impact with 50, 90 and 95 %, and the true"
        f" impact.{omission}",
        impact_points(facts),
    )


def track_section(plots: RunPlots) -> ReportSection | None:
    """Return the consistency and the scores of the tracks."""
    facts = plots.facts
    rows = score_rows(facts)
    if not rows:
        return None
    data = nees_history(facts)
    plot = plot_of(
        "nees",
        lambda axes: nees_plot(axes, facts, data),
        3.8,
        "NEES of the tracks over time since ignition, divided by 6, with the band of 99 %",
        _NEES,
        data,
    )
    table = ReportTable(
        "Scores of the tracks, with 95 % intervals where a run has them", ("", "value"), rows
    )
    return ReportSection("tracks", "How good the tracks are", "", (plot, table))


def provenance_section(plots: RunPlots) -> ReportSection:
    """Return scene, seed, versions and models of the run."""
    manifest = plots.facts.run.manifest
    scene = plots.facts.plan.scene
    versions = ", ".join(f"{name} {version}" for name, version in manifest["versions"].items())
    rows = [
        ("scene", scene.name),
        ("epoch", str(np.datetime64(scene.epoch_us, "us")).removesuffix(".000000") + "Z"),
        ("seed", f"seed {scene.seed}"),
        ("scene hash", str(manifest["scene_hash"])),
        ("versions", versions),
        *((model.path, model.name) for model in _models(scene)),
    ]
    table = ReportTable("The run", ("", "value"), rows)
    return ReportSection("provenance", "How it was made", _MANIFEST, (table,))


def _models(scene: Scene) -> tuple[Choice, ...]:
    return (
        scene.detection,
        scene.classification,
        scene.confidence,
        scene.tracker,
        scene.atmosphere,
        scene.background,
    )


#: The sections of a report, in order.
SECTIONS: tuple[Callable[[RunPlots], ReportSection | None], ...] = (
    map_section,
    detection_section,
    directing_section,
    latency_section,
    delay_section,
    signal_section,
    confidence_section,
    identity_section,
    impact_section,
    track_section,
    provenance_section,
)
