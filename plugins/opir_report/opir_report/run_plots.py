"""`run.plot`: the plots of a run, each a method that returns matplotlib axes."""

from collections.abc import Callable
from functools import cached_property
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes

from opir_core import Run
from opir_report.canvas import STYLE, WIDTH_IN, Plots, new_axes, svg_of, without_data
from opir_report.figure_data import FigureData
from opir_report.plots.confidence import confidence_plot, confidences
from opir_report.plots.consistency import containment_plot, nees_history, nees_plot, region_history
from opir_report.plots.delays import delay_plot, report_delays
from opir_report.plots.directing import direction_plot, directions, directions_height_in
from opir_report.plots.flights import fields_of_view, ground_tracks
from opir_report.plots.footprints import footprint_map
from opir_report.plots.hypotheses import hypotheses_plot, hypothesis_history, weighed_tracks
from opir_report.plots.impact import impact_map
from opir_report.plots.latency import latency_curves, latency_plot, pair_latencies
from opir_report.plots.maps import launch_map, world_map
from opir_report.plots.modes import modes_over_time, modes_plot
from opir_report.plots.scores import score_table
from opir_report.plots.signal import signal_plot, signals
from opir_report.plots.timeline import detection_counts, timeline
from opir_report.run_facts import RunFacts

#: Heights of the maps, inches.
MAP_IN = 4.6
WORLD_IN = 4.5


class RunPlots(Plots):
    """The plots of a run. Each method draws into `ax`, or into a new figure of pyplot, and returns
    the axes.
    """

    def __init__(self, run: Run) -> None:
        self.facts = RunFacts(run)

    @cached_property
    def ground_tracks(self) -> FigureData:
        """The true ground tracks of the launches."""
        return ground_tracks(self.facts.plan)

    def map(self, ax: Axes | None = None) -> Axes:
        """Draw the launches: ground tracks, launch and impact points, the last predicted impact
        regions.

        The projection is azimuthal equidistant about the launches.
        """
        return self._drawn(launch_map, self.ground_tracks, ax=ax, height_in=MAP_IN)

    def world(self, ax: Axes | None = None) -> Axes:
        """Draw the Earth with the satellites, the edges of their fields of view, and the
        launches.
        """
        views = fields_of_view(self.facts.plan)
        return self._drawn(world_map, self.ground_tracks, views, ax=ax, height_in=WORLD_IN)

    def timeline(self, ax: Axes | None = None) -> Axes:
        """Draw the number of detections of each sensor over time, by target."""
        counts = detection_counts(self.facts)
        return self._drawn(timeline, counts, ax=ax, height_in=timeline_height_in(counts))

    def directing(self, ax: Axes | None = None) -> Axes:
        """Draw where the director pointed each narrow field over time: the target of the track that
        it followed, and its turns.
        """
        spans = directions(self.facts)
        height_in = directions_height_in(spans)
        return self._drawn(direction_plot, spans, ax=ax, height_in=height_in)

    def modes(self, ax: Axes | None = None) -> Axes:
        """Draw the modes of sensors over time, and the reasons of their commands."""
        spans = modes_over_time(self.facts)
        return self._drawn(modes_plot, spans, ax=ax, height_in=directions_height_in(spans))

    def footprints(self, ax: Axes | None = None) -> Axes:
        """Draw where on the ground narrow fields looked, by target and mode."""
        return self._drawn(footprint_map, self.ground_tracks, ax=ax, height_in=MAP_IN)

    def impact(self, target: str | None = None, ax: Axes | None = None) -> Axes:
        """Draw the last predicted impact regions of a target with its true impact.

        `target` is an id, by default that of the first target with a predicted impact. `KeyError`
        for an unknown one.
        """

        def draw(axes: Axes, facts: RunFacts) -> Axes:
            if target is None and not facts.last_with_impact:
                return without_data(axes, "no impact was predicted")
            number = min(facts.last_with_impact) if target is None else self._number(target)
            return impact_map(axes, facts, number)

        return self._drawn(draw, ax=ax, height_in=5.0)

    def snr(self, target: str | None = None, ax: Axes | None = None) -> Axes:
        """Draw the expected SNR along the boost of a target, by sensor, in each sensor's reference
        band.

        `target` is an id, by default that of the first launch; so in `probability` and `air`.
        """
        return self._signal("snr", target, ax)

    def probability(self, target: str | None = None, ax: Axes | None = None) -> Axes:
        """Draw P_d of a look along the boost of a target, by sensor."""
        return self._signal("probability", target, ax)

    def air(self, target: str | None = None, ax: Axes | None = None) -> Axes:
        """Draw the transmittance of the air along the boost of a target, by sensor."""
        return self._signal("air", target, ax)

    def confidence(self, ax: Axes | None = None) -> Axes:
        """Draw the confidence of detections over time, by target, and the type probability of
        tracks.
        """
        return self._drawn(confidence_plot, confidences(self.facts), ax=ax)

    def hypotheses(self, track: int | None = None, ax: Axes | None = None) -> Axes:
        """Draw the probability of each hypothesis of a track over time.

        `track` is one of the tracks of the first launches or sources, by default the first.
        `KeyError` for others.
        """
        tracks = list(weighed_tracks(self.facts))
        if track is not None and track not in tracks:
            names = ", ".join(map(str, tracks)) or "none"
            raise KeyError(f"no plot of the track {track}; there are those of {names}")
        number = next(iter(tracks), -1) if track is None else track
        return self._drawn(hypotheses_plot, hypothesis_history(self.facts), number, ax=ax)

    def latency(self, ax: Axes | None = None) -> Axes:
        """Draw the distribution of latencies to the first detection, by sensor type, against the
        closed form.
        """
        pairs = pair_latencies(self.facts)
        return self._drawn(latency_plot, pairs, latency_curves(pairs), ax=ax, height_in=4.0)

    def delays(self, ax: Axes | None = None) -> Axes:
        """Draw the time from looks to their reports over time, by sensor."""
        return self._drawn(delay_plot, report_delays(self.facts), ax=ax)

    def containment(self, ax: Axes | None = None) -> Axes:
        """Draw the area of the 95 % impact regions over time, and whether they contain the true
        impact.
        """
        return self._drawn(containment_plot, region_history(self.facts), ax=ax, height_in=4.0)

    def nees(self, ax: Axes | None = None) -> Axes:
        """Draw the NEES of the tracks' states over time, divided by 6, with its 99 % band."""
        return self._drawn(nees_plot, nees_history(self.facts), ax=ax)

    def scorecard(self, ax: Axes | None = None) -> Axes:
        """Draw the scores of the run's tracks as a table."""
        return self._drawn(score_table, ax=ax, height_in=3.6)

    def _signal(self, panel: str, target: str | None, ax: Axes | None) -> Axes:
        def draw(axes: Axes, facts: RunFacts) -> Axes:
            if not facts.ids:
                return without_data(axes, "the scene has no launches")
            number = 0 if target is None else self._number(target)
            return signal_plot(axes, facts, number, signals(facts, number), panel)

        return self._drawn(draw, ax=ax)

    def _drawn(
        self, draw: Callable[..., Axes], *data: Any, ax: Axes | None, height_in: float = 3.8
    ) -> Axes:
        """Draw into axes, or into a new figure of a height, in the style of reports."""
        axes = new_axes(height_in) if ax is None else ax
        with rc_context(STYLE):
            return draw(axes, self.facts, *data)

    def _number(self, target: str) -> int:
        if target not in self.facts.ids:
            names = ", ".join(self.facts.ids) or "none"
            raise KeyError(f"the run has no target {target!r}; it has {names}")
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
