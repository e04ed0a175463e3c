"""The scorecard of a run as a table of text."""

import math
from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
from opir_scoring import GEOMETRIES, percent_text, scorecard_of

from opir_report.canvas import without_data
from opir_report.palette import GRID, INK
from opir_report.run_facts import SETTINGS, RunFacts


def score_rows(facts: RunFacts) -> list[tuple[str, str]]:
    """Return the figures of a run's tracks, as label and value with its 95 % interval; nothing
    without tracks.
    """
    if not len(facts.run.tracks):
        return []
    figures = scorecard_of([facts.scored], SETTINGS).figures
    rows = _track_rows(figures)
    return rows + [row for name in GEOMETRIES for row in _points(name, figures[name])]


def _track_rows(figures: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the rows of tracks, of all geometries."""
    return [
        ("launches tracked", _text(figures["launches_tracked"], 3)),
        ("tracks per launch", _text(figures["tracks_a_launch"], 2)),
        ("false tracks", f"{figures['false_tracks_a_run']['value']:.0f}"),
        ("purity", _text(figures["purity"], 4)),
        ("completeness", _text(figures["completeness"], 3)),
        ("first track after, s", _text(figures["first_track_after_s"], 2)),
        ("GOSPA per target, m", _text(figures["gospa"]["a_target_m"], 0)),
        ("type correct", _text(figures["type_right"], 3)),
    ]


def _points(geometry: str, figures: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the rows of launch and impact points of one geometry, if it has targets."""
    if not figures["targets"]:
        return []
    name = geometry.replace("_biased", ", biased sensors")
    return [
        (
            f"launch error, m ({name}, n = {figures['launches_reported']})",
            _text(figures["launch_m"], 0),
        ),
        (
            f"impact error, km ({name}, n = {figures['impacts_reported']})",
            _text(figures["impact_m"], 1, 1e-3),
        ),
    ]


def _text(figure: Mapping[str, Any], digits: int, scale: float = 1.0) -> str:
    """Return a value with its interval and its share, `0.98 [0.95, 1.00] (90 %)`; `-` if unknown."""
    if not math.isfinite(figure["value"]):
        return "-"
    value = f"{scale * figure['value']:.{digits}f}"
    low, high = (scale * edge for edge in figure["interval_95"])
    interval = f" [{low:.{digits}f}, {high:.{digits}f}]" if math.isfinite(low) else ""
    share = figure.get("share", 1.0)
    return f"{value}{interval}{f' ({percent_text(share)})' if share != 1.0 else ''}"


def score_table(axes: Axes, facts: RunFacts) -> Axes:
    """Draw the scorecard as a table."""
    rows = score_rows(facts)
    if not rows:
        return without_data(axes, "no tracks to score")
    axes.set_axis_off()
    table = axes.table(
        cellText=[list(row) for row in rows], cellLoc="left", loc="upper left", edges="horizontal"
    )
    table.auto_set_font_size(False)
    table.set_fontsize(9)
    table.scale(1.0, 1.25)
    for cell in table.get_celld().values():
        cell.set_edgecolor(GRID)
        cell.get_text().set_color(INK)
    return axes
