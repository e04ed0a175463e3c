"""What the priors of its class and the window it sees through add to the normal equations of a hypothesis."""

from typing import TYPE_CHECKING

import numpy as np

from opir_core.arrays import BoolArray, FloatArray
from opir_core.tracking.profile.coordinates import BURN, LIFT, PITCH, TURN_EAST, TURN_NORTH, Natural, natural
from opir_core.tracking.profile.family import STRAIGHT_RAD, Priors

if TYPE_CHECKING:
    from opir_core.tracking.profile.fit import Hypotheses

#: The distance of neighbouring windows, of their standard deviation: their sum is 1 to a thousandth.
SPACING = 1.0 / 0.6


def with_priors(
    hypotheses: "Hypotheses", prior: Priors, normal: FloatArray, right: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the normal equations with the priors, the priors' sum of squares at 0 and the log of their height.

    The priors are of natural parameters, linearised where the hypotheses stand. The turn's length is normal about the
    class's along its present direction, which is as likely as any other.
    """
    found = natural(hypotheses.parameters, prior)
    slope, here = found.slope(), hypotheses.parameters
    information = prior.information()
    bent = hypotheses.is_bent > 0
    information[~bent, TURN_EAST] = information[~bent, TURN_NORTH] = 2.0 / np.square(prior.turn_rad[~bent])
    wanted = np.sum(slope * here[:, None], axis=2) - found.parameters
    weighed = slope * information[:, :, None]
    normal = normal + np.sum(weighed[:, :, :, None] * slope[:, :, None], axis=1)
    right = right + np.sum(weighed * wanted[:, :, None], axis=1)
    constant = np.sum(information * wanted * wanted, axis=1)
    sums = normal, right, constant
    height, ring = _with_turn(sums, found, slope, here, prior, bent)
    linear = np.delete(np.log(information), [TURN_EAST, TURN_NORTH], axis=1).sum(axis=1)
    free = np.log(information[:, [TURN_EAST, TURN_NORTH]]).sum(axis=1)
    log = height + 0.5 * linear + np.where(bent, ring, 0.5 * free)
    return normal, right, constant, log + _windowed(hypotheses.window, normal, right, constant)


def _with_turn(
    sums: tuple[FloatArray, FloatArray, FloatArray],
    found: Natural,
    slope: FloatArray,
    here: FloatArray,
    prior: Priors,
    bent: BoolArray,
) -> tuple[FloatArray, FloatArray]:
    """Add the prior of the turn to normal equations, right sides and constants, and what makes headings alike.

    Return the logarithms of the density's height (n,): of the lean and the crowding of headings, and of the ring.
    """
    turn = found.parameters[:, [TURN_EAST, TURN_NORTH]]
    length = np.maximum(np.hypot(turn[:, 0], turn[:, 1]), STRAIGHT_RAD)
    along = turn / length[:, None]
    share = np.where(bent, 1.0 / np.square(prior.turn_sigma_rad), 0.0)
    by_length = np.sum(along[:, :, None] * slope[:, [TURN_EAST, TURN_NORTH]], axis=1)
    missing = prior.turn_rad - length + np.sum(by_length * here, axis=1)
    _add_rows(sums, share, by_length, missing)
    # Farther out than the class's length, as windows beyond it are, headings are told apart: the ring bends away.
    bend = share * np.maximum(1.0 - prior.turn_rad / length, 0.0)
    aside = np.stack([-along[:, 1], along[:, 0]], axis=1)
    by_heading = np.sum(aside[:, :, None] * slope[:, [TURN_EAST, TURN_NORTH]], axis=1)
    _add_rows(sums, bend, by_heading, np.sum(by_heading * here, axis=1))
    # Every heading alike: the density in the plane is that of the length over the length; the lean's over its share.
    crowding = np.where(bent, 1.0 / length, 0.0)[:, None] * by_length
    crowding[:, [BURN, PITCH, LIFT]] += 2.0 * found.lean_slope
    right = sums[1]
    right -= crowding
    height = -2.0 * np.log(found.lean) + np.sum(crowding * here, axis=1)
    ring = -np.log(length) - np.log(prior.turn_sigma_rad) - 0.5 * np.log(2.0 * np.pi)
    return height, ring


def _add_rows(
    sums: tuple[FloatArray, FloatArray, FloatArray], weight: FloatArray, slope: FloatArray, value: FloatArray
) -> None:
    """Add to normal equations, right sides and constants one row each: a value (n,) that goes with slopes (n, 10)."""
    normal, right, constant = sums
    normal += (weight[:, None] * slope)[:, :, None] * slope[:, None]
    right += (weight * value)[:, None] * slope
    constant += weight * value * value


def _windowed(window: FloatArray, normal: FloatArray, right: FloatArray, constant: FloatArray) -> FloatArray:
    """Add the windows (n, 4) through which hypotheses see the lean to their normal equations; return their log heights.

    Windows of one direction are normal curves, evenly spaced, that add up to 1: each hypothesis is the part of the
    whole that its window lets through.
    """
    narrow = window[:, 3]
    for i, row in enumerate((TURN_EAST, TURN_NORTH)):
        right[:, row] += narrow * window[:, i] * window[:, 2]
        for j, column in enumerate((TURN_EAST, TURN_NORTH)):
            normal[:, row, column] += narrow * window[:, i] * window[:, j]
    constant += narrow * np.square(window[:, 2])
    height: FloatArray = np.where(narrow > 0.0, np.log(SPACING / np.sqrt(2.0 * np.pi)), 0.0)
    return height
