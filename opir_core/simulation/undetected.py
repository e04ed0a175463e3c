"""Why a run never detects a target or a source, in words, from a few looks of its pairs."""

from typing import TYPE_CHECKING

import numpy as np

from opir_core.arrays import IntArray
from opir_core.errors import number_of
from opir_core.interfaces.records import Exposures
from opir_core.planning.plan import Plan
from opir_core.planning.sightlines import Blocked
from opir_core.simulation.probability import WatchTest

if TYPE_CHECKING:
    from opir_core.planning.links import Network

_REASONS = {
    Blocked.NO_LOOK: "no scan falls into the {part} before the scene ends",
    Blocked.BEHIND_EARTH: "the Earth is in the way throughout the {part}",
    Blocked.OUTSIDE_FIELD_OF_REGARD: "outside the field of regard throughout the {part}",
    Blocked.BELOW_MINIMUM_ELEVATION: "the sensor stays below the minimum elevation throughout the"
    " {part}",
    Blocked.NEAR_THE_SUN: "the Sun is within the exclusion angle throughout the {part}",
}

#: Looks of a pair that are evaluated, for all of them.
_LOOKS = 16

#: P_d of a look from which a target is missed by chance.
_CHANCE = 0.01


def blocked_text(plan: Plan, row: int) -> str:
    """Return why a pair has no looks."""
    phase = "flight" if plan.sensors[plan.pairs.sensor[row]].follows_bodies else "burn"
    if plan.pairs.target[row] >= len(plan.scene.targets):
        phase = "time of its light"
    return _REASONS[Blocked(int(plan.pairs.blocked[row]))].format(part=phase)


def few_looks(plan: Plan, pair: IntArray) -> tuple[IntArray, IntArray, Exposures]:
    """Return pairs, scans and exposures of a few looks of each of the pairs, which have some."""
    pair, share = np.repeat(pair, _LOOKS), np.tile(np.linspace(0.0, 1.0, _LOOKS), len(pair))
    first_scan = plan.pairs.first_scan[pair]
    last_scan = plan.pairs.last_scan[pair]
    scan = first_scan + np.floor(share * (last_scan - first_scan)).astype(np.int64)
    return pair, scan, plan.look_geometry().exposures(pair, scan)


def undetected_text(plan: Plan, target: int) -> str:
    """Return why a target or source, by its number, was never detected: by all sensors, or by the
    best look of one.

    A detection model with signals says by how much they were too faint (`shortfall_text`).
    """
    pairs = np.flatnonzero(plan.pairs.target == target)
    looking = pairs[plan.pairs.looks[pairs] > 0]
    if not len(looking):
        return " or ".join(sorted({blocked_text(plan, row) for row in pairs.tolist()}))
    pair, scan, exposures = few_looks(plan, looking)
    is_visible = plan.look_geometry().visible(pair, scan)
    if not is_visible.any():
        return "hidden or dark in almost all looks"
    watch = WatchTest.of(plan)
    if watch is not None:
        is_visible &= watch.is_made(pair, scan)
    if not is_visible.any():
        ids = sorted({plan.sensors[number].id for number in plan.pairs.sensor[looking].tolist()})
        return f"not looked at while it shone: {', '.join(ids)} did not look, or failed"
    looks = exposures.take(np.flatnonzero(is_visible))
    if plan.links is not None:
        arriving = _arriving(plan.links, looks)
        if not len(arriving):
            ids = sorted({plan.sensors[number].id for number in looks.sensor.tolist()})
            return f"the reports of {', '.join(ids)} do not arrive"
        looks = looks.take(arriving)
    chances = plan.detection.probability(looks)
    best = int(chances.argmax())
    sensor = plan.sensors[looks.sensor[best]]
    where = f"by {sensor.id} at {looks.time_s[best]:.1f} s"
    if chances[best] < _CHANCE and hasattr(plan.detection, "shortfall_text"):
        return f"{plan.detection.shortfall_text(looks.take([best]))}, {where}"
    if chances[best] > 0.0 and (rare := _too_rare(plan, looking)):
        return rare
    chance = (
        "outside of its narrow field, or by chance, in" if sensor.is_narrow else "by chance, in"
    )
    why = chance if chances[best] > 0.0 else "in"
    count = number_of("look", int(plan.pairs.looks[looking].sum()))
    return f"{why} {count}: P_d at most {chances[best]:.2g}, {where}"


def _arriving(links: "Network", looks: Exposures) -> IntArray:
    """Return the rows of looks whose reports arrive, queues and losses by chance left out."""
    lost_s = {number: links.unheard_s(number) for number in set(looks.sensor.tolist())}
    sightings = zip(looks.sensor.tolist(), looks.time_s.tolist(), strict=True)
    return np.flatnonzero(
        [
            not any(from_s <= time_s < until_s for from_s, until_s in lost_s[number])
            for number, time_s in sightings
        ]
    )


def _too_rare(plan: Plan, pair: IntArray) -> str:
    """Return the reason if every sensor has fewer looks than a report needs, else ""."""
    if plan.detection.confirmation is None:
        return ""
    looks = plan.pairs.looks[pair]
    sensor = plan.pairs.sensor[pair]
    needed, scans = plan.detection.confirmation[sensor].T
    if (looks >= needed).any():
        return ""
    best = int((looks - needed).argmax())
    return (
        f"too few looks: {looks[best]} by {plan.sensors[sensor[best]].id}, which reports after"
        f" {needed[best]} detections in {scans[best]} successive scans"
    )
