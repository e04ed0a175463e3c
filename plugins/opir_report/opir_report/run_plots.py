"""`run.plot`: the plots of a run, each a method that returns matplotlib axes."""

from functools import cached_property

from matplotlib import rc_context
from matplotlib.axes import Axes

from opir_core.simulation.run import Run
from opir_report.canvas import STYLE, WIDTH_IN, new_axes, svg_of, without_data
from opir_report.figure_data import FigureData
from opir_report.plots.flights import fields_of_view, ground_tracks
from opir_report.plots.impact import impact_map
from opir_report.plots.maps import launch_map, world_map
from opir_report.plots.timeline import detection_counts, timeline
from opir_report.run_facts import RunFacts

#: Heights of the maps, inches.
MAP_IN, WORLD_IN = 4.6, 4.5


class RunPlots:
    """The plots of a run. Each method draws into `ax`, or into a new figure of pyplot, and returns the axes."""

    def __init__(self, run: Run) -> None:
        self.facts = RunFacts(run)

    @cached_property
    def ground_tracks(self) -> FigureData:
        """The true ground tracks of the launches."""
        return ground_tracks(self.facts.plan)

    def map(self, ax: Axes | None = None) -> Axes:
        """Draw the launches: ground tracks, launch and impact points, the last predicted impact regions.

        The projection is azimuthal equidistant about the launches.
        """
        axes = new_axes(MAP_IN) if ax is None else ax
        with rc_context(STYLE):
            return launch_map(axes, self.facts, self.ground_tracks)

    def world(self, ax: Axes | None = None) -> Axes:
        """Draw the Earth with the satellites, the edges of their fields of view, and the launches."""
        axes = new_axes(WORLD_IN) if ax is None else ax
        with rc_context(STYLE):
            return world_map(axes, self.facts, self.ground_tracks, fields_of_view(self.facts.plan))

    def timeline(self, ax: Axes | None = None) -> Axes:
        """Draw the number of detections of each sensor over time, by target."""
        counts = detection_counts(self.facts)
        axes = new_axes(timeline_height_in(counts)) if ax is None else ax
        with rc_context(STYLE):
            return timeline(axes, self.facts, counts)

    def impact(self, target: str | None = None, ax: Axes | None = None) -> Axes:
        """Draw the last predicted impact regions of a target with its true impact.

        `target` is an id, by default that of the first target with a predicted impact. `KeyError` for an unknown one.
        """
        axes = new_axes(5.0) if ax is None else ax
        with rc_context(STYLE):
            if target is None and not self.facts.last_with_impact:
                return without_data(axes, "no impact was predicted")
            number = min(self.facts.last_with_impact) if target is None else self._number(target)
            return impact_map(axes, self.facts, number)

    def _number(self, target: str) -> int:
        if target not in self.facts.ids:
            raise KeyError(f"the run has no target {target!r}; it has {', '.join(self.facts.ids) or 'none'}")
        return self.facts.ids.index(target)


def timeline_height_in(counts: FigureData) -> float:
    """Return the height of a timeline, inches."""
    rows = min(len(set(counts["sensor_id"].tolist())), 24) if len(counts) else 3
    return 1.7 + 0.33 * rows


def map_svg(run: Run) -> str:
    """Return the map of a run's launches as an `svg` element, for notebooks and pages."""
    plots = RunPlots(run)
    words = f"Map of the launches of {run.plan.scene.name} with their predicted impact regions"
    return svg_of(lambda figure: plots.map(figure.add_subplot()), (WIDTH_IN, MAP_IN), "map", words)
