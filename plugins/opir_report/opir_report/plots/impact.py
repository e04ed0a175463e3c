"""Predicted impact regions of one target against its true impact."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from opir_core.arrays import FloatArray
from opir_report.canvas import legend_above, without_data
from opir_report.figure_data import FigureData
from opir_report.maps.base_map import drawn_ground, filled
from opir_report.maps.projections import MapProjection, RegionProjection, fitting_projection
from opir_report.palette import INK, PAPER
from opir_report.run_facts import RunFacts, containment_rings
from opir_report.words import shown_unit

_RATIO = 1.45
_LEAST_KM = 4.0
_SHADES = {0.5: 0.55, 0.9: 0.3, 0.95: 0.15}


def impact_points(facts: RunFacts) -> FigureData:
    """Return the last predicted impacts with the true ones, and the areas of the regions: one row
    per launch.

    target_id, tick_s, predicted and true latitude and longitude, deg, area_50, area_90 and area_95,
    km²; nan where unknown.
    """
    rows = []
    for target, name in enumerate(facts.ids):
        row = facts.last_with_impact.get(target)
        point = (
            [np.nan] * 3
            if row is None
            else [facts.run.tracks.tick_s[row], *np.degrees(facts.run.tracks.impact[row, :2])]
        )
        regions = {} if row is None else containment_rings(facts.run.tracks, row)
        areas = [regions[each][0] if each in regions else np.nan for each in _SHADES]
        rows.append(
            (
                name,
                *(
                    float(each)
                    for each in (*point, *np.degrees(facts.true_point(target, "impact")), *areas)
                ),
            )
        )
    names = (
        "tick_s",
        "predicted_latitude_deg",
        "predicted_longitude_deg",
        "true_latitude_deg",
        "true_longitude_deg",
    )
    return FigureData.of_rows(
        ("target_id", *names, "area_50_km2", "area_90_km2", "area_95_km2"), rows
    )


def impact_map(axes: Axes, facts: RunFacts, target: int) -> Axes:
    """Draw the regions that contain the impact with 50, 90 and 95 %, as predicted last, and the
    true impact.
    """
    row = facts.last_with_impact.get(target)
    name = facts.ids[target]
    if row is None:
        return without_data(axes, f"{name}: no impact was predicted")
    true = np.array([facts.true_point(target, "impact")])
    regions = containment_rings(facts.run.tracks, row)
    rings = [ring for _, found in regions.values() for ring in found]
    predicted = facts.run.tracks.impact[row : row + 1, :2]
    places = np.concatenate([true, predicted, *rings])
    places = places[np.isfinite(places).all(axis=1)]
    projection = fitting_projection(places)
    drawn_ground(axes, projection, places, _RATIO, _LEAST_KM, parts=4)
    colour = facts.hues.of_target[target].colour
    marks = _draw_regions(axes, projection, regions, colour)
    style: dict[str, Any] = {
        "marker": "D",
        "linestyle": "",
        "markersize": 5,
        "markerfacecolor": PAPER,
        "zorder": 4,
    }
    marks += axes.plot(
        *projection.points(*predicted.T).T, color=colour, label="predicted impact", **style
    )
    if np.isfinite(true).all():
        cross: dict[str, Any] = {
            "marker": "x",
            "linestyle": "",
            "markersize": 8,
            "markeredgewidth": 2,
            "zorder": 5,
        }
        marks += axes.plot(*projection.points(*true.T).T, color=INK, label="true impact", **cross)
    if isinstance(projection, RegionProjection):
        # The bar is where an oblong region is not.
        east, north = projection.points(*places.T).T
        _scale_bar(
            axes, at_right=float(np.sum((east - east.mean()) * (north - north.mean()))) > 0.0
        )
    axes.set_title(f"{name}, predicted at {facts.run.tracks.tick_s[row]:g} s")
    legend_above(axes, marks)
    return axes


def _draw_regions(
    axes: Axes,
    projection: MapProjection,
    regions: dict[float, tuple[float, list[FloatArray]]],
    colour: str,
) -> list[Line2D]:
    """Draw regions by containment, area and rings, the largest first; return their marks for a
    legend.
    """
    marks = []
    for containment, (area_km2, rings) in sorted(regions.items(), reverse=True):
        shade = _SHADES.get(containment, 0.3)
        filled(axes, projection, rings, facecolor=colour, alpha=shade, linewidth=0.0, zorder=2)
        filled(
            axes, projection, rings, facecolor="none", edgecolor=colour, linewidth=0.8, zorder=2.1
        )
        label = f"{100.0 * containment:g} %: {area_text(area_km2)}"
        marks.append(
            Line2D(
                [],
                [],
                marker="s",
                linestyle="",
                color=colour,
                alpha=shade,
                markersize=8,
                label=label,
            )
        )
    return marks


def _scale_bar(axes: Axes, *, at_right: bool) -> None:
    """Draw a bar of a round length in km in a lower corner."""
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    length = 10.0 ** np.floor(np.log10(0.3 * (east - west)))
    length *= next(each for each in (5.0, 2.0, 1.0) if each * length <= 0.3 * (east - west))
    right = east - 0.04 * (east - west) if at_right else west + 0.04 * (east - west) + length
    height = south + 0.05 * (north - south)
    axes.plot(
        [right - length, right],
        [height, height],
        color=INK,
        linewidth=2,
        solid_capstyle="butt",
        zorder=6,
    )
    axes.annotate(
        f"{length:g} km",
        (right - 0.5 * length, height),
        (0, 3),
        textcoords="offset points",
        ha="center",
        fontsize=8,
    )


def area_text(area_km2: float) -> str:
    """Return an area in two significant digits: `8.5 km²`, `12 000 km²`, `140 million km²`."""
    if not np.isfinite(area_km2):
        return "-"
    short = float(f"{area_km2:.2g}")
    scale = shown_unit("km²", np.array([short]))
    number = short / scale.divisor
    digits = f"{round(number):,}".replace(",", " ") if number >= 10.0 else f"{number:g}"
    return f"{digits} {scale.unit}"
