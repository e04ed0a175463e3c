"""The report of a run: sentences first, then maps, detections, tracks and impacts, each with its data."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from opir_core.cli.answers import answers
from opir_core.scene.scene import Choice, Scene
from opir_core.simulation.run import Run
from opir_report.canvas import WIDTH_IN, svg_of
from opir_report.figure_data import FigureData
from opir_report.pages.files import write_page
from opir_report.pages.page import ReportFigure, ReportPage, ReportSection, ReportTable
from opir_report.plots.flights import fields_of_view, view_time_s
from opir_report.plots.impact import impact_map, impact_points
from opir_report.plots.timeline import detection_counts, timeline
from opir_report.run_plots import MAP_IN, WORLD_IN, RunPlots, timeline_height_in

#: Targets with a map of their impact.
_IMPACTS_SHOWN = 6

_LAUNCHES = (
    "True ground tracks, thick while the target burns; the last predicted impact points with the regions that contain"
    " the impact with 95 %. Azimuthal equidistant projection about the launches."
)
_SATELLITES = (
    "Dashed is the edge of the ground that each can see, a spherical cap. Moving satellites have their ground track"
    " over the run."
)


def write_run_report(run: Run, path: Path, *, with_data: bool = True) -> list[Path]:
    """Write the report of a run; return the files written.

    The data of each figure are written as Parquet into a folder beside the report, `report.data` for `report.html`.
    Raises `SinkError` where a file cannot be written.
    """
    return write_page(run_page(run), path, with_data=with_data)


def run_page(run: Run) -> ReportPage:
    """Return the page of a run."""
    plots = RunPlots(run)
    sections = [
        section
        for make in (_maps, _detections, _impacts, _provenance)
        for section in [make(plots)]
        if section is not None
    ]
    counts, scene = run.summary["counts"], run.plan.scene
    subtitle = (
        f"{counts['sensors']} sensors, {counts['targets']} targets, {counts['detections']} detections in"
        f" {counts['looks']} looks, {counts['tracks']} tracks; {scene.duration_s:g} s, seed {scene.seed}"
    )
    footer = "Written by opir-report. Unclassified textbook physics, notional numbers."
    return ReportPage(
        title=f"Run of {scene.name}", subtitle=subtitle, summary=answers(run.summary), sections=sections, footer=footer
    )


def _figure(
    name: str,
    draw: Callable[[Figure], object],
    height_in: float,
    words: tuple[str, str],
    data: FigureData | None = None,
) -> ReportFigure:
    """Return a figure of a name and a height; `words` are the text for readers who do not see it, and the caption."""
    return ReportFigure(name, svg_of(draw, (WIDTH_IN, height_in), name, words[0]), words[1], data)


def _maps(plots: RunPlots) -> ReportSection:
    run = plots.facts.run
    launches = _figure(
        "launches",
        lambda figure: plots.map(figure.add_subplot()),
        MAP_IN,
        (
            f"Map of {len(plots.facts.ids)} launches with ground tracks, impacts and predicted impact regions",
            _LAUNCHES,
        ),
        plots.ground_tracks,
    )
    views = fields_of_view(run.plan)
    satellites = _figure(
        "satellites",
        lambda figure: plots.world(figure.add_subplot()),
        WORLD_IN,
        (
            f"World map of {len(run.sensors)} sensors with the edges of their fields of view",
            f"Sensors at {view_time_s(run.plan):g} s. {_SATELLITES}",
        ),
        views,
    )
    return ReportSection("map", "Where", "", (launches, satellites))


def _detections(plots: RunPlots) -> ReportSection:
    counts = detection_counts(plots.facts)
    lines = _figure(
        "detections",
        lambda figure: timeline(figure.add_subplot(), plots.facts, counts),
        timeline_height_in(counts),
        (
            "Detections of each sensor over time, by target",
            "Detections over scene time, one row per sensor with its own scale; bars on top are the burns.",
        ),
        counts,
    )
    return ReportSection("detections", "What each sensor detected", "", (lines, _sensor_table(plots)))


def _sensor_table(plots: RunPlots) -> ReportTable:
    names = ("looks", "detections", "noise_detections", "targets_detected")
    rows = [
        (row["sensor_id"], row["sensor_type"], *(str(row[name]) for name in names))
        for row in plots.facts.run.summary["sensors"]
    ]
    return ReportTable("Sensors", ("sensor", "type", "looks", "detections", "false alarms", "targets"), rows)


def _impacts(plots: RunPlots) -> ReportSection | None:
    facts = plots.facts
    shown = list(facts.last_with_impact)[:_IMPACTS_SHOWN]
    if not shown:
        return None
    columns = min(len(shown), 2)
    rows = -(-len(shown) // columns)

    def draw(figure: Figure) -> None:
        for place, target in enumerate(shown, start=1):
            impact_map(figure.add_subplot(rows, columns, place), facts, target)

    more = (
        f" The first {len(shown)} of {len(facts.last_with_impact)}." if len(facts.last_with_impact) > len(shown) else ""
    )
    regions = _figure(
        "impacts",
        draw,
        (3.3 if columns == 2 else 5.0) * rows,
        (
            f"Predicted impact regions of {', '.join(facts.ids[each] for each in shown)} against the true impacts",
            f"The last predicted regions that contain the impact with 50, 90 and 95 %, and the true impact.{more}",
        ),
        impact_points(facts),
    )
    return ReportSection("impacts", "Where they will come down", "", (regions,))


def _provenance(plots: RunPlots) -> ReportSection:
    manifest, scene = plots.facts.run.manifest, plots.facts.plan.scene
    versions = ", ".join(f"{name} {version}" for name, version in manifest["versions"].items())
    chosen = [(each.path, each.name) for each in _choices(scene)]
    rows = [
        ("scene", scene.name),
        ("epoch", str(np.datetime64(scene.epoch_us, "us")) + "Z"),
        ("seed", f"seed {scene.seed}"),
        ("scene hash", str(manifest["scene_hash"])),
        ("versions", versions),
        *chosen,
    ]
    words = "The manifest beside the events holds the whole scene: enough to repeat the run byte for byte."
    return ReportSection("provenance", "How it was made", words, (ReportTable("The run", ("", "value"), rows),))


def _choices(scene: Scene) -> list[Choice]:
    return [scene.detection, scene.classification, scene.confidence, scene.tracker, scene.atmosphere, scene.background]
