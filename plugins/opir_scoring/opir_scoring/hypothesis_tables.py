"""Tables of the scores of hypotheses, and of the times at which launches are recognised."""

from collections.abc import Mapping
from typing import Any

from opir_core.cli import table
from opir_scoring.figure_text import interval_text, number_text

Figures = Mapping[str, Mapping[str, Any]]

#: Largest number of launches whose times are printed one by one; JSON has all.
_FEW = 20

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
        name: own["hypotheses"]
        for name, own in figures.items()
        if own["hypotheses"]["by_age"][-1]["tracks"]
    }
    if not weighed:
        return []
    return ["hypotheses, by age of the track", *_by_age(weighed), *_launches(figures), _LEGEND]


def _by_age(weighed: Figures) -> list[str]:
    ages = zip(*(own["by_age"] for own in weighed.values()), strict=True)
    rows = [
        (part["age"], name, *_age_cells(part))
        for parts in ages
        for name, part in zip(weighed, parts, strict=True)
    ]
    head = (
        "age",
        "tracker",
        "tracks",
        "right, %",
        "log",
        "Brier",
        "P(none)",
        "unknown",
        "AUROC",
        "OSCR",
    )
    confusion = [
        (true, name, ", ".join(f"{best} {count}" for best, count in row.items()))
        for name, own in weighed.items()
        for true, row in own["confusion"].items()
    ]
    parts = [table(head, rows), table(("is", "tracker", "tracks that say"), confusion)]
    for key, label in (
        ("reliability", "stated, most probable"),
        ("launch_reliability", "stated P(launch)"),
    ):
        rows = [
            ("-".join(f"{edge:g}" for edge in part["stated"]), name, *_bin_cells(part))
            for name, own in weighed.items()
            for part in own[key]
            if part["samples"]
        ]
        parts.append(table((label, "tracker", "tracks", "mean", "true"), rows))
    return parts


def _age_cells(part: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        str(part["tracks"]),
        interval_text(part["right"], 0, 100.0),
        interval_text(part["log_score"], 3),
        interval_text(part["brier"], 3),
        interval_text(part["none"], 3),
        str(part["unknown_tracks"]),
        number_text(part["none_auroc"], 3),
        number_text(part["oscr"], 3),
    )


def _bin_cells(part: Mapping[str, Any]) -> tuple[str, ...]:
    return str(part["samples"]), number_text(part["stated_mean"], 3), interval_text(part, 3)


def _launches(figures: Figures) -> list[str]:
    """Return the table of the times at which each launch was recognised, if they are few."""
    rows = [
        (part["target"], str(part["seed"]), name, *(_time_text(part[key]) for key in _TIMES))
        for name, own in figures.items()
        for part in own["recognition"]["launches"]
    ]
    head = ("launch", "seed", "tracker", "recognised after s", "P(launch) > 0.95 after s")
    return [table(head, rows)] if len(rows) <= _FEW * len(figures) else []


def _time_text(after_s: float) -> str:
    return "never" if after_s == float("inf") else number_text(after_s, 1)
