"""Page and plot of `end_to_end.py`, drawn from its CSV file."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from result_files import BLUE, GREEN, ORANGE, RED, Row, markdown_table, number, read_csv, svg_plot

#: The name of the rows with all settings at once.
ALL = "all settings"
#: By setting the error that it is drawn and judged by, and its unit.
ERRORS: Mapping[str, tuple[str, str]] = {
    "trajectory tolerance": ("line_of_sight_urad", "line of sight, µrad"),
    "probability tolerance": ("p_d", "P_d"),
    "light time": ("line_of_sight_urad", "line of sight, µrad"),
    "forces": ("impact_km", "predicted impact, km"),
    "leave out the air": ("p_d", "P_d"),
    "leave out the background": ("p_d", "P_d"),
    "leave out the focal plane": ("counts", "counts, relative"),
    "launches of the classifier": ("type", "share of types"),
    "tracker cadence and slice": ("position_km", "tracked position, km"),
    "impact regions": ("impact_area", "area of regions, relative"),
    "tracker": ("from_truth_km", "impact from truth, km"),
}
COLOURS = {"one": BLUE, "salvo": ORANGE, "raid": GREEN}
#: What is asked of defaults: the error, its words, its bar.
BARS = (
    ("truth_m", "true impact, m", 10.0),
    ("line_of_sight_urad", "line of sight, µrad", 0.1),
    ("p_d", "P_d", 1e-4),
    ("type", "share of types that differ", None),
    ("position_km", "tracked position, km", None),
    ("launch_km", "launch point, km", None),
    ("impact_km", "predicted impact, km", None),
    ("impact_area", "area of 95 % regions, relative", None),
)

PAGE = """# End to end: run time against error

What does each accuracy setting cost a whole run, what does it buy, and are the defaults on the knee?

{answer}

![Error against processor time of a whole process, for each setting; defaults are ringed](end_to_end.svg)

Each setting is varied alone and compared with its most exact level, with the same seed. Scenes: {scenes}.
{duration} s, two SBIRS-GEO with focal planes, in air, with J2 to J4 and drag, spectral types and `imm`. Times are
processor time of whole processes. `leave out …` changes the physics: it shows what a part costs (the focal plane: with
`focal_plane: null` and `nei_w_m2: 1e-12`).{not_run}

All defaults against the most exact settings:

{table}

Errors are largest values, those of tracks root mean squares over launches ([definitions](../how-to/tune.md#errors)).
Those of tracks are differences between two estimates from the same detections. The last predicted impacts are off the
true ones by {truth}: before burnout an impact is hardly known.

All levels: [end_to_end.csv](end_to_end.csv). `opir tune` [picks levels](../how-to/tune.md) for a wanted error.
"""


def write_page(folder: Path) -> None:
    """Write page and plot beside the CSV file in a folder."""
    table = read_csv(folder / "end_to_end.csv")
    scenes = list(dict.fromkeys(row["scene"] for row in table))
    whole = {
        row["scene"]: row for row in table if row["knob"] == ALL and row["level"] == "defaults"
    }
    exact = {row["scene"]: row for row in table if row["knob"] == ALL and row["level"] == "exact"}
    counts = {row["scene"]: row["launches"] for row in table}
    lines = [
        (
            words,
            *(f"{abs(number(whole[name][key])):.2g}" for name in whole),
            "–" if bar is None else f"{bar:g}",
        )
        for key, words, bar in BARS
    ]
    lines.append(
        (
            "processor time, defaults, s",
            *(f"{number(row['processor_s']):.1f}" for row in whole.values()),
            "–",
        )
    )
    lines.append(
        (
            "the same, most exact, s",
            *(f"{number(row['processor_s']):.1f}" for row in exact.values()),
            "–",
        )
    )
    not_run = [name for name in ERRORS if all(row["knob"] != name for row in table)]
    page = PAGE.format(
        answer=answer(table, whole),
        not_run=f" Not run for this page: {', '.join(not_run)}." if not_run else "",
        scenes=", ".join(
            f"{name} ({count} launch{'es' if count != '1' else ''})"
            for name, count in counts.items()
        ),
        duration=table[0]["duration_s"],
        table=markdown_table(
            ("error of defaults", *(f"{name} ({counts[name]})" for name in whole), "bar"), lines
        ),
        truth=", ".join(
            f"{number(row['from_truth_km']):.0f} km ({name})" for name, row in whole.items()
        )
        or "–",
    )
    (folder / "end_to_end.md").write_text(page, encoding="utf-8")
    plot(table, scenes, folder / "end_to_end.svg")


def answer(table: Sequence[Row], whole: Mapping[str, Row]) -> str:
    """Return the sentences of the first screen: bars that are met or missed, and defaults that are
    off the knee.
    """
    missed = [
        f"{words} {number(row[key]):.2g} in `{name}` (bar {bar:g})"
        for name, row in whole.items()
        for key, words, bar in BARS
        if bar is not None and abs(number(row[key])) > bar
    ]
    if not whole:
        return "The rows of all settings together were not run."
    first = (
        "All defaults meet their bars."
        if not missed
        else f"Defaults miss a bar: {'; '.join(missed)}."
    )
    off = list(dict.fromkeys(off_the_knee(table)))
    if not off:
        return (
            f"{first}\nNo other level is both faster by a fifth and as exact as a default: all are"
            f" on the curve."
        )
    return (
        f"{first}\nLevels that are faster by a fifth and no less exact than a default:"
        f" {'; '.join(off)}."
    )


def off_the_knee(table: Sequence[Row]) -> Sequence[str]:
    """Return the levels that beat a default in time by a fifth with no larger error."""
    found = []
    for row in table:
        if row["default"] != "1" or row["knob"] not in ERRORS:
            continue
        key = ERRORS[row["knob"]][0]
        for other in table:
            if (other["scene"], other["knob"]) != (row["scene"], row["knob"]) or other is row:
                continue
            is_exact = abs(number(other[key])) <= abs(number(row[key])) + 1e-12
            if is_exact and number(other["processor_s"]) < 0.8 * number(row["processor_s"]):
                found.append(f"{row['knob']} {other['level']} in `{row['scene']}`")
    return found


def plot(table: Sequence[Row], scenes: Sequence[str], path: Path) -> None:
    """Draw error against time, a panel for each setting."""
    shown = [name for name in ERRORS if any(row["knob"] == name for row in table)]
    if not shown:
        return
    columns = 4
    lines = -(-len(shown) // columns)
    with svg_plot(path, lines, columns, figsize=(13.0, 3.0 * lines), squeeze=False) as (
        figure,
        axes,
    ):
        for place in axes.flat[len(shown) :]:
            place.set_visible(False)
        for place, name in zip(axes.flat, shown, strict=False):
            key, words = ERRORS[name]
            mine = [row for row in table if row["knob"] == name]
            errors = [abs(number(row[key])) for row in mine]
            positive = [each for each in errors if 0.0 < each < float("inf")]
            floor = 0.3 * min(positive, default=1.0)
            for scene in scenes:
                draw(place, [row for row in mine if row["scene"] == scene], key, floor, scene)
            place.loglog()
            place.set_title(name, fontsize=9)
            place.set_ylabel(words, fontsize=8)
            place.tick_params(labelsize=7, which="both")
            place.grid(alpha=0.3)
        for place in axes[-1]:
            place.set_xlabel("processor time, s", fontsize=8)
        figure.legend(
            *axes.flat[0].get_legend_handles_labels(),
            loc="outside lower center",
            ncols=4,
            frameon=False,
        )


def draw(axes: Any, rows: Sequence[Row], key: str, floor: float, scene: str) -> None:
    """Draw the levels of one setting in one scene, the default ringed."""
    points = [
        (number(row["processor_s"]), abs(number(row[key])), row["default"] == "1") for row in rows
    ]
    known = [
        (time, max(error, floor), default)
        for time, error, default in points
        if error < float("inf")
    ]
    if not known:
        return
    times, errors, _ = zip(*known, strict=True)
    axes.plot(times, errors, "o-", markersize=4, color=COLOURS.get(scene, RED), label=scene)
    for time, error, default in known:
        if default:
            axes.plot(time, error, "o", markersize=10, fillstyle="none", color="black")
