"""The page of `open_world`."""

import csv
import io
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from opir_scoring.containments import proportion
from scipy.stats import t as student

PAGE = """# Is what is hot a missile?

Fires burn for hours, launchers climb to orbit, stages fly back. What does `imm` say?

A state is held if it lies in its 95 % ellipsoid: number, share and its 95 % interval (Wilson). Probabilities are
medians over the flights at a mark; P(down) is the sum over the conditions that have a region, 0 without one. *Held by
regions*: of the flights with a 95 % region of the true condition ("burn over" or "relights"), those whose impact it
holds, and the median area. Of a launcher that burns on, a region is that of failures, with their
probability P(down). All marks and figures: [open_world.csv](open_world.csv).

{lines}

Flights are notional and share no code with opir (`benchmarks/ascents.py`, `glide_flights.py`, `foreign_flights.py`).
*Short of orbit*: cut off at 97 % of the orbital speed; *nearly in orbit*: at 7.36 km/s over ground and 150 km, like
Starship IFT-3 (14 March 2024), which came down after half of an orbit. *Back to the site*: first stages that turn and
burn against their motion. Each is a scene of its own before two SBIRS-GEO, or one.
{hour}
By `--write docs/benchmarks`; flights have even seeds from {first}, which nothing was built on.
"""

#: What the page says of the scene of `hour`.
HOUR = """
The scene with fires: 15° by 40° of land with 8 fires and 4 gas flares per million km², glints, noise and twelve
launches, before SBIRS-GEO, DSP and NEXTGEN-GEO, with `detection: snr` and `classification: spectral`. Times are since
ignition; the closed form is that of [what is it?](../explanation/hypotheses.md) for the detections and motion of each
launch.
"""

HEAD = (
    "| mark | state held | P(orbit) | P(down) | P(missile) | held by regions | 10³ km² |\n"
    + "|---" * 7
    + "|"
)

#: Marks of the page.
_SHOWN = ("half of burn", "95 % of burn", "20 s after")


class Row(NamedTuple):
    """Flights of a kind at a mark: numbers, medians of probabilities, regions, and least and median
    area.

    `inside` and `given` are texts, `10 of 12`: impacts in the regions of the likeliest and of the
    true condition.
    """

    kind: str
    mark: str
    flights: int
    tracks: int
    held: int
    burning: float
    orbit: float
    down: float
    missile: float
    glide: float
    regions: int
    inside: str
    given: str
    least_km2: float
    median_km2: float


def page_text(rows: Sequence[Row], ticks: Sequence[str], hours: Sequence[str], first: int) -> str:
    """Return the page: a table of each kind of flights, the shares of all ticks, and the hour."""
    lines = []
    for kind in dict.fromkeys(row.kind for row in rows):
        mine = [row for row in rows if row.kind == kind]
        shown = [
            row for row in mine if row.mark.startswith(_SHOWN) and 2 * row.tracks > mine[0].flights
        ]
        lines += [f"\n## {kind}\n\n{mine[0].flights} flights.\n", HEAD]
        lines += [
            f"| {row.mark} | {held(row.held, row.tracks)} | {row.orbit:.2f} | {row.down:.2f} |"
            f" {row.missile:.2f} |"
            f" {row.given} | {f'{1e-3 * row.median_km2:.3g}' if row.regions else '-'} |"
            for row in shown
        ]
    parts = [f"* {each}" for each in ticks if each]
    if parts:
        lines += [
            (
                "\n## All ticks that have a region\n\nThe region of the likeliest condition holds the"
                " impact in:\n"
            ),
            *parts,
        ]
    return PAGE.format(lines="\n".join([*lines, *hours]), hour=HOUR if hours else "", first=first)


def csv_text(rows: Sequence[Row]) -> str:
    """Return all rows as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(Row._fields)
    writer.writerows(
        [f"{cell:.4g}" if isinstance(cell, float) else cell for cell in row] for row in rows
    )
    return text.getvalue()


def held(count: int, whole: int) -> str:
    """Return a number and its share with a 95 % interval, in percent."""
    share, low, high = (100.0 * value for value in proportion(count, whole))
    return f"{count}, {share:.0f} % [{low:.0f}–{high:.0f}]" if whole else "-"


def interval(shares: np.ndarray) -> str:
    """Return the mean of flights' shares in percent, with a 95 % interval (Student's over
    flights).
    """
    mean = float(shares.mean())
    count = len(shares)
    half = (
        student.ppf(0.975, count - 1) * shares.std(ddof=1) / np.sqrt(count) if count > 1 else np.nan
    )
    return (
        f"{100 * mean:.0f} % [{100 * max(mean - half, 0.0):.0f}–{100 * min(mean + half, 1.0):.0f}]"
    )
