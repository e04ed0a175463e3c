"""One look at each of many objects, by every sensor: plumes against fires, flares and glints, and
the types of launches.

For each object one time is drawn, the same for all sensors, and the report of the last scan before
it is scored: so objects are independent, and sensors are compared in pairs. All settings of the
sensors are default.
"""

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from calibration_scenes import LOOK_SOURCES, launches, slot_scene, source_blocks
from scipy.stats import beta, binomtest, norm, rankdata

import opir_core as opir
from opir_core.flight.boost import boost_profile
from opir_core.scene.scene import REPORTED_TYPES, TARGET_TYPES

SENSORS = ("DSP", "SBIRS-GEO", "NEXTGEN-GEO")
DURATION_S = 256.0
#: From here on every sensor has had the scans that its confirmation counts, s.
WARM_UP_S = 60.0
CODES = (*REPORTED_TYPES, "not reported")
#: Fewest reports of each kind for an area under the curve of reports.
ENOUGH = 20


class Population(NamedTuple):
    """A scene, the kind of each emitter (a type, or a kind of source) and the moment looked at."""

    scene: dict[str, Any]
    kind: np.ndarray
    moment_s: np.ndarray


class Looks(NamedTuple):
    """Of one sensor, for each emitter: ln of the odds of a missile (-inf unreported), reported
    code, posterior.
    """

    log_odds: np.ndarray
    code: np.ndarray
    probability: np.ndarray


def population(count, sources, seed):
    """Return launches of each type and sources of each kind, with every sensor."""
    rng = np.random.default_rng([seed, 17])
    targets = launches(rng, TARGET_TYPES, count)
    blocks = source_blocks(rng, LOOK_SOURCES, sources)
    sensors = {model: {"model": model} for model in SENSORS}
    scene = slot_scene(sensors, DURATION_S, seed, targets=targets, sources=blocks)
    source_kinds = np.repeat(list(LOOK_SOURCES), sources)
    kind = np.concatenate([[target["type"] for target in targets], source_kinds])
    burn_s = [boost_profile(target["profile"]).burn_time_s for target in targets]
    end_s = np.append(burn_s, np.full(len(source_kinds), DURATION_S))
    start_s = np.where(np.isin(kind, TARGET_TYPES), 0.0, WARM_UP_S)
    return Population(scene, kind, start_s + (end_s - start_s) * rng.random(len(kind)))


def simulated(people):
    """Return the classifier and the run of a population."""
    scene = opir.scene_from_mapping(people.scene)
    return opir.compile_plan(scene).classifier, opir.simulate(scene)


def looks_at(people, classifier, run):
    """Return, by sensor id, the report on each emitter from the last scan before its moment."""
    detections = run.detections
    target = run.truth.target
    moment_ns = np.append(np.round(people.moment_s * 1e9).astype(np.int64), -1)
    age_ns = moment_ns[target] - detections.time_ns
    log_odds = classifier.log_odds(detections.type_log_probability)
    count = len(people.kind)
    looks = {}
    for number, sensor in enumerate(run.sensors):
        is_final = (age_ns >= 0) & (age_ns < sensor.scan.period_ns)
        rows = np.flatnonzero((detections.sensor == number) & is_final)
        look = Looks(
            np.full(count, -np.inf),
            np.full(count, len(REPORTED_TYPES)),
            np.full((count, len(REPORTED_TYPES)), np.nan),
        )
        look.log_odds[target[rows]] = log_odds[rows]
        look.code[target[rows]] = detections.reported_type[rows]
        look.probability[target[rows]] = detections.type_probability[rows]
        looks[sensor.id] = look
    return looks


def is_right(looks, kind):
    """Return which looks at launches are reported with their type."""
    is_launch = np.isin(kind, TARGET_TYPES)
    return np.asarray(np.array(CODES)[looks.code[is_launch]] == kind[is_launch])


def placements(plume, other):
    """Return how often each plume scores above the others, and each other below the plumes; ties
    count half.
    """
    count = len(plume)
    ranks = rankdata(np.concatenate([plume, other]))
    above = (ranks[:count] - rankdata(plume)) / len(other)
    return above, 1.0 - (ranks[count:] - rankdata(other)) / count


def area(plume, other):
    """Return the area under the ROC curve with DeLong's 95 % interval, which has hardly a width
    where little overlaps.

    The least area is at most that of Clopper and Pearson for the smaller number of objects, were
    all separated.
    """
    above, below = placements(plume, other)
    sigma = np.sqrt(above.var(ddof=1) / len(above) + below.var(ddof=1) / len(below))
    middle = float(above.mean())
    fewest = min(len(above), len(below))
    least = min(middle - 1.96 * sigma, interval(fewest, fewest)[0])
    return middle, max(least, 0.0), min(middle + 1.96 * sigma, 1.0)


def influences(plume, other):
    """Return the area of scores above -inf, and the first-order contribution of each object, seen
    or not.
    """
    visible = [np.isfinite(plume), np.isfinite(other)]
    scores = placements(plume[visible[0]], other[visible[1]])
    middle = float(scores[0].mean())
    added = [np.zeros(len(plume)), np.zeros(len(other))]
    for column, is_seen, score in zip(added, visible, scores, strict=True):
        column[is_seen] = (score - middle) / is_seen.mean()
    return middle, added


def area_gain(worse, better, *, of_looks):
    """Return the gain of an area on the same objects, its standard deviation, and one-sided p.

    Both are scores of plumes and of others. Of looks, unseen objects score below all; else they are
    left out.
    """
    least = -1e300 if of_looks else -np.inf
    areas, added = zip(
        *(
            influences(*(np.maximum(score, least) for score in scores))
            for scores in (worse, better)
        ),
        strict=True,
    )
    gain = areas[1] - areas[0]
    variances = [np.var(b - a, ddof=1) / len(a) for a, b in zip(*added, strict=True)]
    sigma = float(np.sqrt(sum(variances)))
    return gain, sigma, float(norm.sf(gain / sigma)) if sigma > 0.0 else 1.0


def type_gain(worse, better):
    """Return the gain of a share of the same looks, and one-sided p (McNemar, exact)."""
    more = int(np.sum(better & ~worse))
    less = int(np.sum(worse & ~better))
    p = binomtest(more, more + less, 0.5, alternative="greater").pvalue if more + less else 1.0
    return (more - less) / len(worse), float(p)


def interval(hits, count):
    """Return the 95 % interval of a share (Clopper and Pearson)."""
    low = 0.0 if hits == 0 else float(beta.ppf(0.025, hits, count - hits + 1))
    return low, 1.0 if hits == count else float(beta.ppf(0.975, hits + 1, count - hits))


def area_orders(people, looks, *, of_looks):
    """Return each step of the order of sensors with gain, deviation and p."""
    plume = np.isin(people.kind, TARGET_TYPES)
    scores = [[looks[sensor].log_odds[plume], looks[sensor].log_odds[~plume]] for sensor in SENSORS]
    pairs = zip(pairwise(SENSORS), pairwise(scores), strict=True)
    return [(*names, *area_gain(*both, of_looks=of_looks)) for names, both in pairs]


def type_orders(people, looks):
    """Return each step of the order of sensors with gain and p."""
    right = {sensor: is_right(looks[sensor], people.kind) for sensor in SENSORS}
    return [
        (worse, better, *type_gain(right[worse], right[better]))
        for worse, better in pairwise(SENSORS)
    ]


def area_rows(people, looks):
    """Yield the areas of each sensor against each kind, of reports and of looks."""
    plume = np.isin(people.kind, TARGET_TYPES)
    for name in ("reports", "looks"):
        for sensor in SENSORS:
            score = looks[sensor].log_odds
            shown = np.isfinite(score) | (name == "looks")
            for kind in (*LOOK_SOURCES, "all"):
                other = ~plume if kind == "all" else people.kind == kind
                scores = [score[plume & shown], score[other & shown]]
                counts = [len(part) for part in scores]
                if name == "looks" or min(counts) >= ENOUGH:
                    middle, low, high = area(*scores)
                    row = {"sensor": sensor, "against": kind, "of": name, "auc": middle}
                    counted = {"plumes": counts[0], "others": counts[1]}
                    yield {**row, "low": low, "high": high, **counted}


def confusion_rows(people, looks):
    """Yield how often looks at objects of each kind are reported as each type."""
    kinds = (*TARGET_TYPES, *LOOK_SOURCES)
    for sensor in SENSORS:
        for kind in kinds:
            codes = looks[sensor].code[people.kind == kind]
            for number, code in enumerate(CODES):
                hits = int(np.sum(codes == number))
                low, high = interval(hits, len(codes))
                row = {"sensor": sensor, "true_type": kind, "reported": code, "count": hits}
                share = {"share": hits / len(codes), "low": low, "high": high}
                yield {**row, "looks": len(codes), **share}
