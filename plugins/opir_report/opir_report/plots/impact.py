"""Predicted impact regions of one target against its true impact."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from opir_core.arrays import FloatArray
from opir_report.canvas import legend_above, legend_entry, without_data
from opir_report.figure_data import FigureData
from opir_report.maps.base_map import drawn_ground, filled
from opir_report.maps.projections import MapProjection, RegionProjection, fitting_projection
from opir_report.palette import INK, PAPER
from opir_report.run_facts import Containment, RunFacts, containment_rings
from opir_report.words import shown_unit

#: Opacity of a region by its containment.
_SHADES = {0.5: 0.55, 0.9: 0.3, 0.95: 0.15}


def impact_points(facts: RunFacts) -> FigureData:
    """Return the last predicted impacts with the true ones, and the areas of the regions: one row
    per launch.

    target_id, tick_s, predicted and true latitude and longitude, deg, area_50, area_90 and area_95,
    km²; nan where unknown.
    """
    rows = [(name, *_impact_row(facts, target)) for target, name in enumerate(facts.ids)]
    names = (
        "target_id",
        "tick_s",
        "predicted_latitude_deg",
        "predicted_longitude_deg",
        "true_latitude_deg",
        "true_longitude_deg",
        "area_50_km2",
        "area_90_km2",
        "area_95_km2",
    )
    return FigureData.of_rows(names, rows)


def _impact_row(facts: RunFacts, target: int) -> list[float]:
    """Return time and place of the last predicted impact, the true one, and the areas."""
    impact = np.degrees(facts.true_point(target, "impact")).tolist()
    row = facts.last_with_impact.get(target)
    if row is None:
        return [np.nan] * 3 + impact + [np.nan] * len(_SHADES)
    tracks = facts.run.tracks
    regions = containment_rings(tracks, row)
    areas = [regions[share].area_km2 if share in regions else np.nan for share in _SHADES]
    return [
        float(tracks.tick_s[row]),
        *np.degrees(tracks.impact[row, :2]).tolist(),
        *impact,
        *areas,
    ]


def impact_map(axes: Axes, facts: RunFacts, target: int) -> Axes:
    """Draw the regions that contain the impact with 50, 90 and 95 %, as predicted last, and the
    true impact.
    """
    row = facts.last_with_impact.get(target)
    name = facts.ids[target]
    if row is None:
        return without_data(axes, f"{name}: no impact was predicted")
    tracks = facts.run.tracks
    regions = containment_rings(tracks, row)
    impact = np.array([facts.true_point(target, "impact")])
    prediction = tracks.impact[row : row + 1, :2]
    rings = [ring for region in regions.values() for ring in region.rings]
    places = np.concatenate([impact, prediction, *rings])
    places = places[np.isfinite(places).all(axis=1)]
    projection = fitting_projection(places)
    drawn_ground(axes, projection, places, 1.45, least_km=4.0, meridians=4)
    colour = facts.hues.of_target[target].colour
    marks = [
        *_draw_regions(axes, projection, regions, colour),
        *_draw_points(axes, projection, prediction, impact, colour),
    ]
    if isinstance(projection, RegionProjection):
        _draw_scale_bar(axes, projection.points(*places.T))
    axes.set_title(f"{name}, predicted at {tracks.tick_s[row]:g} s")
    legend_above(axes, marks)
    return axes


def _draw_points(
    axes: Axes,
    projection: MapProjection,
    prediction: FloatArray,
    impact: FloatArray,
    colour: str,
) -> list[Line2D]:
    """Draw the predicted and the true impact (1, 2), rad, if it is known; return their marks."""
    marks = axes.plot(
        *projection.points(*prediction.T).T,
        color=colour,
        label="predicted impact",
        marker="D",
        linestyle="",
        markersize=5,
        markerfacecolor=PAPER,
        zorder=4,
    )
    if np.isfinite(impact).all():
        marks += axes.plot(
            *projection.points(*impact.T).T,
            color=INK,
            label="true impact",
            marker="x",
            linestyle="",
            markersize=8,
            markeredgewidth=2,
            zorder=5,
        )
    return marks


def _draw_regions(
    axes: Axes, projection: MapProjection, regions: dict[float, Containment], colour: str
) -> list[Line2D]:
    """Draw regions by containment, the largest first; return their marks for a legend."""
    marks = []
    for containment, (area_km2, rings) in sorted(regions.items(), reverse=True):
        shade = _SHADES.get(containment, 0.3)
        draw_region(axes, projection, rings, colour, shade, linewidth=0.8)
        label = f"{100.0 * containment:g} %: {area_text(area_km2)}"
        marks.append(
            legend_entry(label, colour, marker="s", linestyle="", alpha=shade, markersize=8)
        )
    return marks


def draw_region(
    axes: Axes,
    projection: MapProjection,
    rings: list[FloatArray],
    colour: str,
    alpha: float,
    linewidth: float,
) -> None:
    """Draw the rings of a region: filled, and its edge."""
    filled(axes, projection, rings, facecolor=colour, alpha=alpha, linewidth=0.0, zorder=2)
    filled(
        axes,
        projection,
        rings,
        facecolor="none",
        edgecolor=colour,
        linewidth=linewidth,
        zorder=2.1,
    )


def _draw_scale_bar(axes: Axes, points: FloatArray) -> None:
    """Draw a bar of a round length in km in the lower corner where oblong points (n, 2) are not."""
    deviation = points - points.mean(axis=0)
    is_right = float(np.sum(deviation[:, 0] * deviation[:, 1])) > 0.0
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    length = 10.0 ** np.floor(np.log10(0.3 * (east - west)))
    length *= next(digit for digit in (5.0, 2.0, 1.0) if digit * length <= 0.3 * (east - west))
    margin = 0.04 * (east - west)
    right = east - margin if is_right else west + margin + length
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
    rounded_km2 = float(f"{area_km2:.2g}")
    scale = shown_unit("km²", np.array([rounded_km2]))
    number = rounded_km2 / scale.divisor
    digits = f"{round(number):,}".replace(",", " ") if number >= 10.0 else f"{number:g}"
    return f"{digits} {scale.unit}"
