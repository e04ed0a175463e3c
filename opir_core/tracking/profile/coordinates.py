"""The coordinates in which boosts are fitted: what looks see of a burn that goes on, apart from what they do not.

Burnout speed, burn time, speed shape and turn, as the classes have their priors, are seen only together before the burn
ends: looks tell the acceleration at the start, how fast it grows, and how far the path leans at some time. In the
former the posterior is long, thin and bent, and no normal distribution; in the latter it is nearly one, for what bent
it was the choice of parameters (Bates and Watts, "Relative curvature measures of nonlinearity", J. R. Statist. Soc. B
42, 1980, 1: parameter-effects curvature).

Columns of `parameters`, as in `family`: east and north, m, and start, s, as they are; the lean from the
vertical at the reference time, as a vector, rad; and logarithms, zero at the class's medians: of the acceleration at
the start, of the burn time, of the rate at which acceleration grows, of the pitch exponent, of the time of the pitch
start. The natural parameters have in these places the turn, and logarithms over medians of burnout speed, burn time,
speed shape, pitch exponent and the pitch start's share of the burn.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from opir_core.arrays import FloatArray

if TYPE_CHECKING:
    from opir_core.tracking.profile.family import Priors

EAST, NORTH, START, TURN_EAST, TURN_NORTH, SPEED, BURN, SHAPE, PITCH, LIFT = range(10)
SIZE = 10

#: The reference time at which the lean is a parameter, over the class's burn time.
REFERENCE = 0.4

#: No pitch start comes later in the burn than this share.
LAST_LIFT = 0.5

#: The power of the mean that stands for the lesser of two pitch starts: 1.5 % below either of them at twice the other.
_SHARP = 4.0

#: The least of the turn's share that is reached at the reference time.
_LEAST_LEAN = 1e-3


class Natural(NamedTuple):
    """Natural parameters (n, 10) and how they change with the fitted ones.

    `by_burn` and `by_rate` (n,) are the slopes of the logarithm of burnout speed by those of burn time and growth rate;
    `lean` (n,) is the share of the turn that is reached at the reference time, `lean_slope` (n, 3) its logarithm's
    slopes by the logarithms of burn time, pitch exponent and pitch start.
    """

    parameters: FloatArray
    by_burn: FloatArray
    by_rate: FloatArray
    lean: FloatArray
    lean_slope: FloatArray

    def slope(self) -> FloatArray:
        """Return the slopes (n, 10, 10) of natural parameters, by row, by fitted ones, by column."""
        found = np.zeros((len(self.lean), SIZE, SIZE))
        found[:, np.arange(SIZE), np.arange(SIZE)] = 1.0
        found[:, SPEED, BURN], found[:, SPEED, SHAPE] = self.by_burn, self.by_rate
        found[:, SHAPE, BURN], found[:, LIFT, BURN] = 1.0, -1.0
        for turn in (TURN_EAST, TURN_NORTH):
            found[:, turn, turn] = 1.0 / self.lean
            found[:, turn, [BURN, PITCH, LIFT]] = -self.parameters[:, turn, None] * self.lean_slope
        return found


def natural(parameters: FloatArray, priors: "Priors") -> Natural:
    """Return the natural parameters of fitted ones (n, 10), of classes with priors of one row each."""
    found = parameters.copy()
    found[:, SHAPE] += parameters[:, BURN]
    found[:, LIFT] -= parameters[:, BURN]
    shape = priors.speed_shape * np.exp(found[:, SHAPE])
    found[:, SPEED] += parameters[:, BURN] + _growth(shape) - _growth(priors.speed_shape)
    by_rate = shape * (1.0 / -np.expm1(-shape) - 1.0 / shape)
    lean, slope = _leans(found, priors)
    found[:, [TURN_EAST, TURN_NORTH]] /= lean[:, None]
    return Natural(found, 1.0 + by_rate, by_rate, lean, slope)


def fitted(parameters: FloatArray, priors: "Priors") -> FloatArray:
    """Return the fitted parameters (n, 10) of natural ones, of classes with priors of one row each."""
    found = parameters.copy()
    found[:, SHAPE] -= parameters[:, BURN]
    found[:, LIFT] += parameters[:, BURN]
    shape = priors.speed_shape * np.exp(parameters[:, SHAPE])
    found[:, SPEED] -= parameters[:, BURN] + _growth(shape) - _growth(priors.speed_shape)
    found[:, [TURN_EAST, TURN_NORTH]] *= _leans(parameters, priors)[0][:, None]
    return found


def _growth(shape: FloatArray) -> FloatArray:
    """Return the logarithms (n,) of the burnout speed over what the acceleration at the start alone would come to."""
    grown: FloatArray = np.log(np.expm1(shape) / shape)
    return grown


def _leans(parameters: FloatArray, priors: "Priors") -> tuple[FloatArray, FloatArray]:
    """Return the share (n,) of the turn reached at the reference time, of natural parameters, and its slopes (n, 3)."""
    reference = REFERENCE * np.exp(-parameters[:, BURN])
    latest, wanted = LAST_LIFT * reference, priors.lift * np.exp(parameters[:, LIFT])
    # The lesser of both, without a corner: in one a fit that follows slopes goes to and fro.
    lift = (wanted**-_SHARP + latest**-_SHARP) ** (-1.0 / _SHARP)
    # A burn so short that it is over by the reference time has turned all it turns.
    is_open = reference < 1.0
    rest = np.where(is_open, 1.0 - lift, 1.0)
    share = np.where(is_open, (reference - lift) / rest, 1.0)
    exponent = priors.pitch_exponent * np.exp(parameters[:, PITCH])
    angle = 0.5 * np.pi * share**exponent
    by_angle = angle / np.tan(angle) * exponent
    slope = np.stack(
        [
            -by_angle / rest * is_open,
            by_angle * np.log(share),
            by_angle * (lift / rest - lift / (reference - lift)) * (lift / wanted) ** _SHARP,
        ],
        axis=1,
    )
    return np.maximum(np.sin(angle), _LEAST_LEAN), slope
