"""The probability of each hypothesis of tracks over time."""

from matplotlib.axes import Axes

from opir_report.canvas import legend_of, without_data
from opir_report.figure_data import FigureData
from opir_report.palette import series_hue
from opir_report.run_facts import RunFacts


def weighed_tracks(facts: RunFacts) -> dict[int, str]:
    """Return the tracks of the first launches, then of other hot sources, four in all, with their
    names; none without hypotheses.
    """
    if not facts.run.tracks.hypothesis_probability.shape[1]:
        return {}
    summary = facts.run.summary
    names = [
        (row["track_id"], f"{row[f'{kind}_id']} ({row[f'{kind}_type']})")
        for kind in ("target", "source")
        for row in summary[f"{kind}s"]
    ]
    return dict([(track, name) for track, name in names if track is not None][:4])


def hypothesis_history(facts: RunFacts) -> FigureData:
    """Return the probabilities of the hypotheses of `weighed_tracks`, tick by tick, of those that
    ever reach 1 %.

    track_id, of (the launch or source), tick_s, hypothesis, probability.
    """
    tracks = facts.run.tracks
    history = list[tuple[object, ...]]()
    for track, name in weighed_tracks(facts).items():
        rows = tracks.take(tracks.track == track)
        for place, hypothesis in enumerate(facts.plan.hypothesis_names):
            probability = rows.hypothesis_probability[:, place]
            if (probability >= 0.01).any():
                history += [
                    (track, name, tick_s, hypothesis, value)
                    for tick_s, value in zip(
                        rows.tick_s.tolist(), probability.tolist(), strict=True
                    )
                ]
    return FigureData.of_rows(("track_id", "of", "tick_s", "hypothesis", "probability"), history)


def hypotheses_plot(axes: Axes, facts: RunFacts, data: FigureData, track: int) -> Axes:
    """Draw the probability of each hypothesis of a track over time."""
    history = data.at("track_id", track) if len(data) else data
    if not len(history):
        return without_data(axes, "the tracker weighs no hypotheses")
    hues = [series_hue(number, name) for number, name in enumerate(facts.plan.hypothesis_names)]
    for hue in hues:
        line = history.at("hypothesis", hue.label)
        axes.plot(line["tick_s"], line["probability"], **hue.style)
    axes.set(
        xlabel="scene time, s",
        ylabel="probability",
        ylim=(-0.03, 1.03),
        title=f"{history['of'][0]}, track {track}",
    )
    names = history.levels("hypothesis")
    legend_of(axes, [hue for hue in hues if hue.label in names])
    return axes
