"""The page of the tracking set, from its rows of figures."""

from collections.abc import Callable, Sequence
from math import isfinite, isnan

from result_files import Row, markdown_table, number
from set_cases import CASES, SEEDS
from set_files import CUTOFF_OF_BOUND, VERSION

#: The share of states in their 95 % ellipsoids above which a tracker counts as consistent on the
#: page.
HELD = 0.9


def page(rows: Sequence[Row]) -> str:
    """Return the page."""
    scored = [row for row in rows if row["covered"]]
    names = list(dict.fromkeys(row["tracker"] for row in scored))
    cases = [name for name in dict.fromkeys(row["case"] for row in scored) if name != "all"]
    whole = {row["tracker"]: row for row in scored if row["case"] == "all" or len(cases) == 1}
    spent = sum(number(row["processor_s"]) for row in rows if row["processor_s"])
    cells = {(row["tracker"], row["case"]): row for row in scored}

    def by_case(text: Callable[[Row], str], first: Callable[[Row], str] | None = None) -> str:
        head = ["case", *(["c"] if first else []), *names]
        lines = []
        for case in cases:
            own = [cells[name, case] for name in names]
            lines.append([case, *([first(own[0])] if first else []), *(text(row) for row in own)])
        return markdown_table(head, lines)

    return f"""# Tracking set

How well does a tracker follow boosts by lines of sight alone, on flights that follow no tracker's prior?
{len(CASES)} cases of {len(SEEDS)} scenes each, version {VERSION}, free for any use (CC0): flights, sensors, lines of
sight, bounds and scores. [Enter your own tracker](../how-to/enter-the-tracking-benchmark.md).

```
python benchmarks/tracking_set/tracking_set.py --generate tracking-set
opir score tracking-set --tracks my_tracks.csv
```

## All cases

{markdown_table(HEAD, ([name, *overall(whole[name])] for name in names))}

{verdict(whole)}

`kepler-arc` fits free flights: while a target burns it is mostly off by more than c, and its tracks are false.

False: tracks of no launch; missed: launches without a track, of {next(iter(whole.values()))["launches"]}. GOSPA/c:
over the cut-off; a launch missed at a tick costs 0.71. /bound: RMS of the error over the bound that knows the law of
flights, and mean energy score over an efficient tracker's. Log: log score of the state, nats above it. NEES/6: median;
0.89 is consistent. [All definitions](../how-to/enter-the-tracking-benchmark.md#score).

## Cases

{markdown_table(("case", "scene"), ((name, CASES[name].question) for name in cases))}

## GOSPA by case, m

Of positions, per launch, mean over ticks. The cut-off c is {CUTOFF_OF_BOUND:g} times the median bound of position in
each scene; it is in `set.json`.

{by_case(lambda row: plain(row["gospa_m"]), cutoff)}

## Energy score of position over the bound's

1 is efficient; over covered ticks.

{by_case(lambda row: plain(row["energy_over_bound"]))}

## States in their 95 % ellipsoids, %

{by_case(lambda row: share(row["held_95"]))}

## How it is made

* **Flights** are point masses with thrust, drag and gravity, integrated by the set itself: no code and no curve of
  opir's target models or trackers. One to three stages, dark times of 4 to 15 s in `gaps`, thrust off the velocity by a
  constant angle in upper stages; laws of all parameters in `benchmarks/tracking_set/set_flights.py`.
* **Lines of sight** have normal errors of the stated standard deviation, isotropic across the line; a burning target
  above the horizon is detected with P_d 0.95, a dark one never; light takes no time. In `wrong-noise` 30 % of the
  errors are three times as large as stated, in `bias-unstated` a bias of 60 µrad is not stated.
* **Bounds**: the posterior Cramér–Rao bound of the flight's parameters under their laws, with biases as unknowns and
  known association (van Trees); and one with unknown thrust. A tracker that does not know the law stays above the
  first.
* **Scored** is a launch from its third detection to 20 s after its last burnout, every 5 s.
* **Trackers** know what `set.json` says: noise, P_d, density of clutter, bias; nothing was tuned to the set. opir's
  have a scene with `detection: constant` and `classification: none`. The Stone Soup trackers are those of
  [opir's adapter](../how-to/stone-soup.md) at its defaults. The LMB filter is a labelled multi-Bernoulli
  filter with one normal distribution a label and belief propagation (`benchmarks/tracking_set/set_lmb.py`); Stone Soup
  has none. Rows of `imm` with P(launch) of at most 0.5 are left out;
  its states are scored as normal distributions, without the radii that it reports. Versions: {versions(whole)}

A full run takes {spent:.0f} s of processor time: {times(rows)}. All figures: [tracking_set.csv](tracking_set.csv).
"""


HEAD = (
    *(
        "tracker",
        "covered, %",
        "false",
        "missed",
        "GOSPA/c",
        "error /bound",
        "energy /bound",
        "log",
    ),
    *("NEES/6", "held, %"),
)


def overall(row: Row) -> list[str]:
    """Return the cells of a tracker's figures over all cases."""
    low, high = (100.0 * number(row[f"held_95_{end}95"]) for end in ("low", "high"))
    return [
        f"{100.0 * number(row['covered']):.0f}",
        *(row[name] for name in ("false_tracks", "missed_launches")),
        f"{number(row['gospa_over_cutoff']):.2f}",
        *(
            plain(row[name])
            for name in ("error_over_bound", "energy_over_bound", "log_score_above_bound")
        ),
        plain(row["nees_over_6_median"]),
        f"{100.0 * number(row['held_95']):.0f} [{low:.0f}, {high:.0f}]",
    ]


def verdict(whole: dict[str, Row]) -> str:
    """Return which trackers have the least GOSPA and energy score, and which are consistent."""
    gospa, energy = (
        min(whole, key=lambda name: number(whole[name][key]))
        for key in ("gospa_over_cutoff", "energy_over_bound")
    )
    held = [name for name, row in whole.items() if number(row["held_95"]) >= HELD]
    both = (
        f"{gospa} has the least GOSPA/c{' and' if gospa == energy else f', {energy}'} the least"
        f" energy score"
    )
    words = (
        f"{', '.join(held)} hold"
        if len(held) > 1
        else f"only {held[0]} holds"
        if held
        else "none holds"
    )
    return f"{both}; {words} at least {HELD:.0%} of the states in 95 % ellipsoids.".replace(
        "%", " %"
    ).replace("  ", " ")


def cutoff(row: Row) -> str:
    """Return the cut-off distances of a case."""
    low = plain(row["cutoff_least_m"])
    high = plain(row["cutoff_most_m"])
    return low if low == high else f"{low}–{high}"


def plain(text: str) -> str:
    """Return a number with two digits after the point below 10, one below 100, none above; a dash
    for none.
    """
    value = number(text)
    if not isfinite(value):
        return "–" if isnan(value) else "∞"
    return f"{value:.{2 if abs(value) < 10.0 else 1 if abs(value) < 100.0 else 0}f}"


def share(text: str) -> str:
    """Return a share in per cent; a dash for none."""
    return "–" if isnan(number(text)) else f"{100.0 * number(text):.0f}"


def versions(whole: dict[str, Row]) -> str:
    """Return the versions of the trackers."""
    return ", ".join(dict.fromkeys(row["version"] for row in whole.values())) + "."


def times(rows: Sequence[Row]) -> str:
    """Return the processor times of the parts of a run."""
    return ", ".join(
        f"{row['tracker']} {number(row['processor_s']):.0f} s" for row in rows if row["processor_s"]
    )
