"""The sections of a run's report: each makes its figures, or None where the run has nothing to
show.
"""

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.figure import Figure

from opir_core import Scene
from opir_core.cli import grouped, source_table, track_table
from opir_core.scene import Choice
from opir_report.canvas import WIDTH_IN, svg_of
from opir_report.figure_data import FigureData
from opir_report.pages.page import ReportFigure, ReportSection, ReportTable
from opir_report.plots.confidence import confidence_plot, confidences
from opir_report.plots.consistency import containment_plot, nees_history, nees_plot, region_history
from opir_report.plots.flights import fields_of_view, view_time_s
from opir_report.plots.hypotheses import hypotheses_plot, hypothesis_history, weighed_tracks
from opir_report.plots.impact import impact_map, impact_points
from opir_report.plots.latency import latency_curves, latency_plot, pair_latencies
from opir_report.plots.scores import score_rows
from opir_report.plots.signal import PANELS, signal_plot, signals
from opir_report.plots.timeline import detection_counts, timeline
from opir_report.run_plots import MAP_IN, WORLD_IN, RunPlots, timeline_height_in

#: Targets with a map of their impact, and with plots of their signal.
_IMPACTS_SHOWN = 6
_SIGNALS_SHOWN = 2
#: Rows of a table.
_ROWS_SHOWN = 20

_LAUNCHES = (
    "True ground tracks, thick while the target burns; the last predicted impact points with the"
    " regions that contain"
    " the impact with 95 %. Azimuthal equidistant projection about the launches."
)
_SATELLITES = (
    "Dashed is the edge of the ground that each can see, a spherical cap. Moving satellites have"
    " their ground track"
    " over the run."
)
_SIGNAL = (
    "What a look would measure along the boost, for each sensor while it sees the target: the"
    " expected signal-to-noise"
    " ratio and the transmittance of the air in the sensor's reference band, and the probability of"
    " detection."
)
_LATENCY = (
    "Share of the pairs of sensor and launch with a detection after at most that time. Dashed is"
    " the closed form, the"
    " mean over the same pairs: for a constant P_d that of a scan of random or aligned phase, else"
    " the product over the"
    " scheduled looks. Pairs that see the launch only later are left out."
)
_HYPOTHESES = (
    "What the tracker holds possible, tick by tick: the probability of each hypothesis that ever"
    " reaches 1 %. First the"
    " launches, then other hot sources."
)
_CONTAINMENT = (
    "Area of the region that contains the impact with 95 %, tick by tick: filled where the true"
    " impact is inside."
    " Estimates of one target are dependent, so the shares in the title have no interval."
)
_NEES = (
    "Normalised estimation error squared of the state, divided by its 6 degrees of freedom: 1 is"
    " consistent. Shaded is"
    " where 99 % of single samples of a consistent filter lie."
)


def figure_of(
    name: str,
    draw: Callable[[Figure], object],
    height_in: float,
    words: tuple[str, str],
    data: FigureData | None = None,
) -> ReportFigure:
    """Return a figure of a name and a height; `words` are the text for readers who do not see it,
    and the caption.
    """
    return ReportFigure(
        name, svg_of(draw, (WIDTH_IN, height_in), name, words[0]), words[1], data, draw, height_in
    )


def map_section(plots: RunPlots) -> ReportSection:
    """Return the maps."""
    run = plots.facts.run
    count = len(plots.facts.ids)
    alt = f"Map of {count} launches with ground tracks, impacts and predicted impact regions"
    launches = figure_of(
        "launches",
        lambda figure: plots.map(figure.add_subplot()),
        MAP_IN,
        (alt, _LAUNCHES),
        plots.ground_tracks,
    )
    views = fields_of_view(run.plan)
    words = (
        f"World map of {len(run.sensors)} sensors with the edges of their fields of view",
        f"Sensors at {view_time_s(run.plan):g} s. {_SATELLITES}",
    )
    satellites = figure_of(
        "satellites", lambda figure: plots.world(figure.add_subplot()), WORLD_IN, words, views
    )
    return ReportSection("map", "Where", "", (launches, satellites))


def detection_section(plots: RunPlots) -> ReportSection:
    """Return the timeline and the table of sensors."""
    counts = detection_counts(plots.facts)
    words = (
        "Detections of each sensor over time, by target",
        (
            "Detections over scene time, one row per sensor with its own scale; bars on top are the"
            " burns."
        ),
    )
    lines = figure_of(
        "detections",
        lambda figure: timeline(figure.add_subplot(), plots.facts, counts),
        timeline_height_in(counts),
        words,
        counts,
    )
    names = ("looks", "detections", "noise_detections", "targets_detected")
    rows = [
        (row["sensor_id"], row["sensor_type"], *(grouped(row[name]) for name in names))
        for row in plots.facts.run.summary["sensors"]
    ]
    sensors = ReportTable(
        "Sensors", ("sensor", "type", "looks", "detections", "false alarms", "targets"), rows
    )
    found = [
        (row["sensor_id"], row["health"]["text"])
        for row in plots.facts.run.summary["sensors"]
        if row["health"]
    ]
    health = (
        [ReportTable("What the tracker found of them", ("sensor", "found"), found)] if found else []
    )
    return ReportSection("detections", "What each sensor detected", "", (lines, sensors, *health))


def signal_section(plots: RunPlots) -> ReportSection | None:
    """Return SNR, P_d and air along the boost of the first launches, if the detection model has a
    signal.
    """
    facts = plots.facts
    parts = []
    for target in range(min(facts.launches, _SIGNALS_SHOWN)):
        data = signals(facts, target)
        if len(data) and np.isfinite(data["snr"]).any():
            parts.append(_signal_figure(plots, target, data))
    more = (
        f" The first {len(parts)} of {facts.launches} launches."
        if facts.launches > len(parts)
        else ""
    )
    return (
        ReportSection("signal", "Signal, probability and air", _SIGNAL + more, parts)
        if parts
        else None
    )


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
    words = (
        (
            f"Expected SNR, probability of detection and transmittance along the boost of {name}, by"
            f" sensor"
        ),
        f"{name} along its boost.",
    )
    return figure_of(f"signal-{target + 1}", draw, 7.2, words, data)


def latency_section(plots: RunPlots) -> ReportSection | None:
    """Return the distribution of latencies against the closed form."""
    pairs = pair_latencies(plots.facts)
    if not pairs:
        return None
    data = latency_curves(pairs)
    words = (
        (
            "Distribution of the latency to the first detection by sensor type, against the closed"
            " form"
        ),
        _LATENCY,
    )
    plot = figure_of(
        "latency",
        lambda figure: latency_plot(figure.add_subplot(), plots.facts, pairs, data),
        3.9,
        words,
        data,
    )
    return ReportSection("latency", "How soon", "", (plot,))


def confidence_section(plots: RunPlots) -> ReportSection | None:
    """Return the confidence over time."""
    data = confidences(plots.facts)
    if not len(data):
        return None
    words = (
        "Confidence of detections over time since ignition, and type probability of the tracks",
        (
            "Confidence of detections by target or type, with the track's probability of its likeliest"
            " type."
        ),
    )
    plot = figure_of(
        "confidence",
        lambda figure: confidence_plot(figure.add_subplot(), plots.facts, data),
        3.7,
        words,
        data,
    )
    return ReportSection("confidence", "How sure", "", (plot,))


def identity_section(plots: RunPlots) -> ReportSection | None:
    """Return what tracks may be, and the other hot sources, if the tracker weighs hypotheses or
    there are sources.
    """
    facts = plots.facts
    parts: list[ReportFigure | ReportTable] = []
    data = hypothesis_history(facts)
    shown = weighed_tracks(facts)
    if len(data):

        def draw(figure: Figure) -> None:
            for place, track in enumerate(shown, start=1):
                hypotheses_plot(figure.add_subplot(len(shown), 1, place), facts, data, track)

        alt = (
            f"Probability of each hypothesis over time of the tracks of {', '.join(shown.values())}"
        )
        parts.append(figure_of("hypotheses", draw, 2.6 * len(shown), (alt, _HYPOTHESES), data))
        parts += _table_of("Tracks", *track_table(facts.run.summary))
    parts += _table_of("Other hot sources", *source_table(facts.run.summary))
    return ReportSection("identity", "What they are", "", parts) if parts else None


def _table_of(
    caption: str, head: Sequence[str], rows: Sequence[Sequence[str]]
) -> list[ReportFigure | ReportTable]:
    more = f", the first {_ROWS_SHOWN} of {len(rows)}" if len(rows) > _ROWS_SHOWN else ""
    return [ReportTable(f"{caption}{more}", head, rows[:_ROWS_SHOWN])] if rows else []


def impact_section(plots: RunPlots) -> ReportSection | None:
    """Return the predicted impact regions: maps of the last ones, areas and containment over
    time.
    """
    facts = plots.facts
    shown = list(facts.last_with_impact)[:_IMPACTS_SHOWN]
    if not shown:
        return None
    columns = min(len(shown), 2)
    rows = -(-len(shown) // columns)

    def draw(figure: Figure) -> None:
        for place, target in enumerate(shown, start=1):
            impact_map(figure.add_subplot(rows, columns, place), facts, target)

    total = len(facts.last_with_impact)
    more = f" The first {len(shown)} of {total}." if total > len(shown) else ""
    words = (
        (
            f"Predicted impact regions of {', '.join(facts.ids[each] for each in shown)} against the"
            f" true impacts"
        ),
        (
            f"The last predicted regions that contain the impact with 50, 90 and 95 %, and the true"
            f" impact.{more}"
        ),
    )
    height_in = (4.4 if columns == 2 else 5.6) * rows
    regions = figure_of("impacts", draw, height_in, words, impact_points(facts))
    history = region_history(facts)
    words = (
        "Area of the 95 % impact regions over time, and whether they contain the true impact",
        _CONTAINMENT,
    )
    areas = figure_of(
        "regions",
        lambda figure: containment_plot(figure.add_subplot(), facts, history),
        4.0,
        words,
        history,
    )
    return ReportSection("impacts", "Where they will come down", "", (regions, areas))


def track_section(plots: RunPlots) -> ReportSection | None:
    """Return the consistency and the scores of the tracks."""
    facts = plots.facts
    rows = score_rows(facts)
    if not rows:
        return None
    data = nees_history(facts)
    words = (
        "NEES of the tracks over time since ignition, divided by 6, with the band of 99 %",
        _NEES,
    )
    plot = figure_of(
        "nees", lambda figure: nees_plot(figure.add_subplot(), facts, data), 3.8, words, data
    )
    table = ReportTable(
        "Scores of the tracks, with 95 % intervals where a run has them", ("", "value"), rows
    )
    return ReportSection("tracks", "How good the tracks are", "", (plot, table))


def provenance_section(plots: RunPlots) -> ReportSection:
    """Return what the run was made of."""
    manifest = plots.facts.run.manifest
    scene = plots.facts.plan.scene
    versions = ", ".join(f"{name} {version}" for name, version in manifest["versions"].items())
    rows = [
        ("scene", scene.name),
        ("epoch", str(np.datetime64(scene.epoch_us, "us")).removesuffix(".000000") + "Z"),
        ("seed", f"seed {scene.seed}"),
        ("scene hash", str(manifest["scene_hash"])),
        ("versions", versions),
        *((each.path, each.name) for each in _choices(scene)),
    ]
    words = (
        "The manifest beside the events holds the whole scene: enough to repeat the run byte for"
        " byte."
    )
    return ReportSection(
        "provenance", "How it was made", words, (ReportTable("The run", ("", "value"), rows),)
    )


def _choices(scene: Scene) -> list[Choice]:
    return [
        scene.detection,
        scene.classification,
        scene.confidence,
        scene.tracker,
        scene.atmosphere,
        scene.background,
    ]


#: The sections of a report, in order.
SECTIONS: tuple[Callable[[RunPlots], ReportSection | None], ...] = (
    map_section,
    detection_section,
    latency_section,
    signal_section,
    confidence_section,
    identity_section,
    impact_section,
    track_section,
    provenance_section,
)
