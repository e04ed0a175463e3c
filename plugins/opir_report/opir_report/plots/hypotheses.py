"""What tracks may be, over time: the probability of each hypothesis."""

from matplotlib.axes import Axes

from opir_report.canvas import legend_of, without_data
from opir_report.figure_data import FigureData
from opir_report.palette import series_hue
from opir_report.run_facts import RunFacts

#: Tracks that are shown, and the highest probability from which a hypothesis is drawn.
_SHOWN = 4
_LEAST = 0.01


def weighed_tracks(facts: RunFacts) -> dict[int, str]:
    """Return the tracks of the first launches, then of other hot sources, with their names; none
    without hypotheses.
    """
    if not facts.run.tracks.hypothesis_probability.shape[1]:
        return {}
    summary = facts.run.summary
    named = [
        (row["track_id"], f"{row['target_id']} ({row['target_type']})")
        for row in summary["targets"]
    ]
    named += [
        (row["track_id"], f"{row['source_id']} ({row['source_type']})")
        for row in summary["sources"]
    ]
    return dict([(track, name) for track, name in named if track is not None][:_SHOWN])


def hypothesis_history(facts: RunFacts) -> FigureData:
    """Return the probabilities of the hypotheses of `weighed_tracks`, tick by tick, of those that
    ever reach 1 %.

    track_id, of (the launch or source), tick_s, hypothesis, probability.
    """
    rows = facts.run.tracks
    names = facts.plan.hypothesis_names
    found = []
    for track, name in weighed_tracks(facts).items():
        own = rows.take(rows.track == track)
        for place, hypothesis in enumerate(names):
            chances = own.hypothesis_probability[:, place]
            if (chances >= _LEAST).any():
                both = zip(own.tick_s.tolist(), chances.tolist(), strict=True)
                found += [(track, name, tick_s, hypothesis, chance) for tick_s, chance in both]
    return FigureData.of_rows(("track_id", "of", "tick_s", "hypothesis", "probability"), found)


def hypotheses_plot(axes: Axes, facts: RunFacts, data: FigureData, track: int) -> Axes:
    """Draw the probability of each hypothesis of a track over time."""
    own = data.where(data["track_id"] == track) if len(data) else data
    if not len(own):
        return without_data(axes, "the tracker weighs no hypotheses")
    shown = set(own["hypothesis"].tolist())
    hues = [series_hue(number, name) for number, name in enumerate(facts.plan.hypothesis_names)]
    for hue in hues:
        line = own.where(own["hypothesis"] == hue.label)
        axes.plot(line["tick_s"], line["probability"], color=hue.colour, linestyle=hue.dashes)
    axes.set(
        xlabel="scene time, s",
        ylabel="probability",
        ylim=(-0.03, 1.03),
        title=f"{own['of'][0]}, track {track}",
    )
    legend_of(axes, [hue for hue in hues if hue.label in shown])
    return axes
