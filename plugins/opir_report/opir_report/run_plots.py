"""`run.plot`: the plots of a run, each a method that returns matplotlib axes."""

from functools import cached_property

from matplotlib import rc_context
from matplotlib.axes import Axes

from opir_core import Run
from opir_report.canvas import STYLE, WIDTH_IN, new_axes, svg_of, without_data
from opir_report.figure_data import FigureData
from opir_report.plots.confidence import confidence_plot, confidences
from opir_report.plots.consistency import containment_plot, nees_history, nees_plot, region_history
from opir_report.plots.flights import fields_of_view, ground_tracks
from opir_report.plots.hypotheses import hypotheses_plot, hypothesis_history, weighed_tracks
from opir_report.plots.impact import impact_map
from opir_report.plots.latency import latency_curves, latency_plot, pair_latencies
from opir_report.plots.maps import launch_map, world_map
from opir_report.plots.scores import score_table
from opir_report.plots.signal import signal_plot, signals
from opir_report.plots.timeline import detection_counts, timeline
from opir_report.run_facts import RunFacts

#: Heights of the maps, inches.
MAP_IN = 4.6
WORLD_IN = 4.5


class RunPlots:
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
        axes = new_axes(MAP_IN) if ax is None else ax
        with rc_context(STYLE):
            return launch_map(axes, self.facts, self.ground_tracks)

    def world(self, ax: Axes | None = None) -> Axes:
        """Draw the Earth with the satellites, the edges of their fields of view, and the
        launches.
        """
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

        `target` is an id, by default that of the first target with a predicted impact. `KeyError`
        for an unknown one.
        """
        axes = new_axes(5.0) if ax is None else ax
        with rc_context(STYLE):
            if target is None and not self.facts.last_with_impact:
                return without_data(axes, "no impact was predicted")
            number = min(self.facts.last_with_impact) if target is None else self._number(target)
            return impact_map(axes, self.facts, number)

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
        axes = new_axes(3.8) if ax is None else ax
        with rc_context(STYLE):
            return confidence_plot(axes, self.facts, confidences(self.facts))

    def hypotheses(self, track: int | None = None, ax: Axes | None = None) -> Axes:
        """Draw the probability of each hypothesis of a track over time.

        `track` is one of the tracks of the first launches or sources, by default the first.
        `KeyError` for others.
        """
        axes = new_axes(3.8) if ax is None else ax
        known = list(weighed_tracks(self.facts))
        if track is not None and track not in known:
            raise KeyError(
                f"no plot of the track {track}; there are those of"
                f" {', '.join(map(str, known)) or 'none'}"
            )
        number = next(iter(known), -1) if track is None else track
        with rc_context(STYLE):
            return hypotheses_plot(axes, self.facts, hypothesis_history(self.facts), number)

    def latency(self, ax: Axes | None = None) -> Axes:
        """Draw the distribution of latencies to the first detection, by sensor type, against the
        closed form.
        """
        axes = new_axes(4.0) if ax is None else ax
        pairs = pair_latencies(self.facts)
        with rc_context(STYLE):
            return latency_plot(axes, self.facts, pairs, latency_curves(pairs))

    def containment(self, ax: Axes | None = None) -> Axes:
        """Draw the area of the 95 % impact regions over time, and whether they contain the true
        impact.
        """
        axes = new_axes(4.0) if ax is None else ax
        with rc_context(STYLE):
            return containment_plot(axes, self.facts, region_history(self.facts))

    def nees(self, ax: Axes | None = None) -> Axes:
        """Draw the NEES of the tracks' states over time, divided by 6, with its 99 % band."""
        axes = new_axes(3.8) if ax is None else ax
        with rc_context(STYLE):
            return nees_plot(axes, self.facts, nees_history(self.facts))

    def scorecard(self, ax: Axes | None = None) -> Axes:
        """Draw the scores of the run's tracks as a table."""
        axes = new_axes(3.6) if ax is None else ax
        with rc_context(STYLE):
            return score_table(axes, self.facts)

    def _signal(self, panel: str, target: str | None, ax: Axes | None) -> Axes:
        axes = new_axes(3.8) if ax is None else ax
        with rc_context(STYLE):
            if not self.facts.ids:
                return without_data(axes, "the scene has no launches")
            number = 0 if target is None else self._number(target)
            return signal_plot(axes, self.facts, number, signals(self.facts, number), panel)

    def _number(self, target: str) -> int:
        if target not in self.facts.ids:
            raise KeyError(
                f"the run has no target {target!r}; it has {', '.join(self.facts.ids) or 'none'}"
            )
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
