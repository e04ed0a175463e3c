"""What `mode_mixing` works out of the weights of modes for columns of tracks, for one track's numbers."""

from collections.abc import Sequence
from math import exp

Pair = tuple[float, float]


def shared(weight: Pair, leave: Pair) -> tuple[Pair, Pair, Pair]:
    """Return the weights of boost and coast after a step, and of what shares of both modes each is mixed.

    `leave` are the chances of leaving each mode. A target that burns has not coasted before.
    """
    boost, coast = weight
    ends, begins = boost * leave[0], coast * leave[1]
    burning, coasting = boost - ends + begins, coast - begins + ends
    into_boost = (1.0 - begins / burning, begins / burning) if burning > 0.0 else (0.0, 0.0)
    into_coast = (ends / coasting, 1.0 - ends / coasting) if coasting > 0.0 else (0.0, 0.0)
    if boost > 0.5 and leave[0] > 0.0:
        into_coast = (1.0, 0.0)
    return (burning, coasting), into_boost, into_coast


def paced(
    pace: Sequence[float], hits: float, silent_s: float, step_s: float, memory_s: float, pause_s: float
) -> tuple[float, tuple[float, float, float]]:
    """Return what a slice takes from the boost's log weight, and the pace after it, as `mode_mixing._missed`."""
    if hits:
        fade, pause = exp(-step_s / memory_s), min(pace[2], pause_s)
        spell = step_s if pause <= step_s else step_s + pause - silent_s
        return 0.0, (hits + fade * pace[0], spell + fade * pace[1], silent_s)
    return -pace[0] / max(pace[1], step_s) * step_s, (pace[0], pace[1], pace[2] + step_s)


def burnt_out(pace: Sequence[float], force: Sequence[float]) -> tuple[list[float], list[float]]:
    """Return by how much position and velocity are less, and their doubt, had the force ended after the last look."""
    hits, spell, silent = pace
    pause = spell / max(hits, 1.0)
    since, doubt = max(silent - pause, 0.0), min(pause, silent)
    times = 0.5 * since * since, since, since * doubt, doubt
    shifts = [time * part for time in times for part in force]
    return shifts[:6], shifts[6:]


def reweighed(weight: Sequence[float], change: Pair, least: float) -> Pair:
    """Return weights times exp(change), normalised, none of a mode in use below the least."""
    if weight[0] <= 0.0 or weight[1] <= 0.0:
        return weight[0], weight[1]
    most = max(change)
    boost, coast = weight[0] * exp(change[0] - most), weight[1] * exp(change[1] - most)
    floor = least * (boost + coast)
    boost, coast = max(boost, floor), max(coast, floor)
    return boost / (boost + coast), coast / (boost + coast)
