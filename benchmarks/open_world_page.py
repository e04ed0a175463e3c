"""The page of `open_world`."""

import numpy as np
from opir_scoring.containments import proportion
from scipy.stats import t as student

PAGE = """# Is what is hot a missile?

Fires burn for hours, launchers climb to orbit, stages fly back. What does `imm` say of them, with default settings?

A state is held if it lies in its 95 % ellipsoid: number, share and its 95 % interval (Wilson). Probabilities, *burns*
among them, are medians over the flights at a mark; P(down) is the sum over the conditions that have a region, 0 without
one. *Regions* are tracks with a 95 % region, *main* how many of the likeliest condition's hold the true impact, *given*
those of the condition that is true ("burn over" or "relights"), the last column the least and the median area. A region
is of what comes down: of a launcher that burns on it is that of failures, with their probability P(down).
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
    "| mark | tracks | held | burns | P(orbit) | P(down) | P(missile) | P(glide) | regions | main | given | 10³ km² |",
    "|---" * 12 + "|",
)


def held(count: int, whole: int) -> str:
    """Return a number and its share with a 95 % interval, in percent."""
    share, low, high = (100.0 * value for value in proportion(count, whole))
    return f"{count}, {share:.0f} % [{low:.0f}–{high:.0f}]" if whole else "-"


def interval(shares: np.ndarray) -> str:
    """Return the mean of flights' shares in percent, with a 95 % interval (Student's over flights)."""
    mean, count = float(shares.mean()), len(shares)
    half = student.ppf(0.975, count - 1) * shares.std(ddof=1) / np.sqrt(count) if count > 1 else np.nan
    return f"{100 * mean:.0f} % [{100 * max(mean - half, 0.0):.0f}–{100 * min(mean + half, 1.0):.0f}]"
