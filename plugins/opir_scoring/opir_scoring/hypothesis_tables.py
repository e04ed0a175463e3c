"""Tables of the scores of hypotheses, and of the times at which launches are recognised."""

from collections.abc import Mapping
from typing import Any

from opir_core.cli import table
from opir_scoring.figure_text import cells, figure_rows, interval_text, number_text

Figures = Mapping[str, Mapping[str, Any]]

_TIMES = ("recognised_after_s", "sure_after_s")

_LEGEND = """\
Log: -ln of the probability of what is true; Brier: from 0 to 2; P(none): mean of "none of these" for known classes;
AUROC, OSCR: of "none of these" and of open-set classification, where a class is unknown to the tracker.
Stated: probability of the most probable hypothesis, or of a launch, at the last estimate of each track, and the share
of tracks of which it is true."""


def hypothesis_tables(figures: Figures) -> list[str]:
    """Return the tables of hypotheses of trackers' figures; none where no tracker weighs
    hypotheses.
    """
    weighed = {
        name: of_tracker["hypotheses"]
        for name, of_tracker in figures.items()
        if of_tracker["hypotheses"]["by_age"][-1]["tracks"]
    }
    if not weighed:
        return []
    return ["hypotheses, by age of the track", *_by_age(weighed), *_launches(figures), _LEGEND]


_AGE = figure_rows(
    ("right, %", "right", 0, 100.0),
    ("log", "log_score", 3),
    ("Brier", "brier", 3),
    ("P(none)", "none", 3),
)
_OPEN_SET = figure_rows(("AUROC", "none_auroc", 3), ("OSCR", "oscr", 3))


def _by_age(weighed: Figures) -> list[str]:
    rows = [
        (
            scores["age"],
            name,
            str(scores["tracks"]),
            *cells(scores, _AGE),
            str(scores["unknown_tracks"]),
            *cells(scores, _OPEN_SET),
        )
        for of_age in zip(*(figures["by_age"] for figures in weighed.values()), strict=True)
        for name, scores in zip(weighed, of_age, strict=True)
    ]
    labels = [row.label for row in _AGE]
    open_set_labels = [row.label for row in _OPEN_SET]
    head = ("age", "tracker", "tracks", *labels, "unknown", *open_set_labels)
    return [
        table(head, rows),
        _confusion(weighed),
        _reliability(weighed, "reliability", "stated, most probable"),
        _reliability(weighed, "launch_reliability", "stated P(launch)"),
    ]


def _confusion(weighed: Figures) -> str:
    rows = [
        (true, name, ", ".join(f"{best} {count}" for best, count in row.items()))
        for name, figures in weighed.items()
        for true, row in figures["confusion"].items()
    ]
    return table(("is", "tracker", "tracks that say"), rows)


def _reliability(weighed: Figures, key: str, label: str) -> str:
    rows = [
        ("-".join(f"{edge:g}" for edge in bin_["stated"]), name, *_bin_cells(bin_))
        for name, figures in weighed.items()
        for bin_ in figures[key]
        if bin_["samples"]
    ]
    return table((label, "tracker", "tracks", "mean", "true"), rows)


def _bin_cells(bin_: Mapping[str, Any]) -> tuple[str, ...]:
    return str(bin_["samples"]), number_text(bin_["stated_mean"], 3), interval_text(bin_, 3)


def _launches(figures: Figures) -> list[str]:
    """Return the table of the times at which each launch was recognised, if they are few."""
    rows = [
        (launch["target"], str(launch["seed"]), name, *(_time_text(launch[key]) for key in _TIMES))
        for name, of_tracker in figures.items()
        for launch in of_tracker["recognition"]["launches"]
    ]
    head = ("launch", "seed", "tracker", "recognised after s", "P(launch) > 0.95 after s")
    # JSON has the times of many launches.
    return [table(head, rows)] if len(rows) <= 20 * len(figures) else []


def _time_text(after_s: float) -> str:
    return "never" if after_s == float("inf") else number_text(after_s, 1)
