"""Cramér-Rao bounds at burnout of launch point, velocity and impact from lines of sight.

Of a launch with a known profile six things are unknown: where it started (two), when, its azimuth,
its burnout speed and its burnout flight path angle. Each look that detects measures two angles with
the sensor's sigma; the pointing bias of a sensor is one more unknown vector, with its own standard
deviation. The information of looks is weighed by P_d. The bounds are of a tracker that knows the
profile: real ones, which do not, have larger errors.

Source: H. L. Van Trees, Detection, Estimation, and Modulation Theory I (1968), section 2.4.
"""

from collections.abc import Sequence

import numpy as np
from attrs import frozen
from numpy.typing import NDArray

from opir_core.arrays import FloatArray, IntArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_ROTATION_RAD_S
from opir_core.flight import kepler_impact, launch_site
from opir_coverage.launches import GridBoosts, LaunchPlaces

#: Steps of differences: of burnout speed, as a share of it, and of the flight path angle, rad.
_SPEED_SHARE = 1e-4
_ANGLE_RAD = 1e-4
#: Scales of the unknowns: metres north and east, seconds, azimuth in rad, burnout speed in m/s,
#: angle in rad.
_SCALES = np.array([1e3, 1e3, 1.0, 1e-2, 10.0, 1e-2])
#: Root-mean-square distance, m, from a point of the Earth to one that may be anywhere on it: √((π²
#: - 4) / 2) radii.
_ANYWHERE_M = EARTH_EQUATORIAL_RADIUS_M * np.sqrt(0.5 * np.pi**2 - 2.0)
#: Unknowns in units of `_SCALES` with less information than this are not observable.
_LEAST_INFORMATION = 1e-12
#: The entries of a symmetric matrix (3, 3) that are kept, and where in it they are.
_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
_MATRIX = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])


@frozen(eq=False)
class LaunchSlopes:
    """Derivatives (n, 3, 6) of positions by the unknowns of launches, in units of `_SCALES`."""

    places: LaunchPlaces
    path: GridBoosts
    faster: GridBoosts
    steeper: GridBoosts

    @classmethod
    def of(cls, places: LaunchPlaces) -> "LaunchSlopes":
        """Return the derivatives of launches from places."""
        speed_m_s = _SPEED_SHARE * places.profile.burnout_speed_m_s
        faster = places.path(0.0, speed_m_s=speed_m_s)
        steeper = places.path(0.0, angle_rad=_ANGLE_RAD)
        return cls(places, places.path(0.0), faster, steeper)

    def at(self, since_s: float) -> FloatArray:
        """Return the derivatives of positions at a scene time, `since_s` after nominal ignition."""
        position, velocity, faster, steeper = self._states(since_s)
        slopes = self._moved(position - self.path.launch_m, position)
        slopes[:, :, 2] = -velocity
        slopes[:, :, 4] = faster[0]
        slopes[:, :, 5] = steeper[0]
        return slopes * _SCALES

    def at_burnout(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return positions and velocities (n, 3) at burnout, and their derivatives (n, 3, 6)."""
        position, velocity, faster, steeper = self._states(self.places.profile.burn_time_s)
        slopes = self._moved(position - self.path.launch_m, position)
        turned = self._moved(velocity, velocity, is_free=True)
        for column, changes in ((4, faster), (5, steeper)):
            slopes[:, :, column], turned[:, :, column] = changes
        return position, velocity, slopes * _SCALES, turned * _SCALES

    def _states(
        self, since_s: float
    ) -> tuple[FloatArray, FloatArray, list[FloatArray], list[FloatArray]]:
        everyone = np.arange(len(self.places))
        time_s = np.full(len(everyone), min(since_s, self.path.burnout_s))
        nominal = self.path.state(everyone, time_s)
        speed_m_s = _SPEED_SHARE * self.places.profile.burnout_speed_m_s
        faster, steeper = (
            [(new - old) / step for new, old in zip(state, nominal, strict=True)]
            for state, step in (
                (self.faster.state(everyone, time_s), speed_m_s),
                (self.steeper.state(everyone, time_s), _ANGLE_RAD),
            )
        )
        return *nominal, faster, steeper

    def _moved(
        self, offset: FloatArray, position: FloatArray, *, is_free: bool = False
    ) -> FloatArray:
        """Return derivatives of vectors by the launch's place and azimuth, which rotate them.

        `offset` is from the launch, `position` from the Earth's axis; free vectors turn only.
        """
        site = launch_site(
            self.places.latitude_rad, self.places.longitude_rad, np.zeros(len(self.places))
        )
        east = site.axes[:, 0]
        up = site.axes[:, 2]
        pole = np.broadcast_to(np.array([0.0, 0.0, 1.0]), up.shape)
        from_centre = offset if is_free else offset + site.meridian_radius_m[:, None] * up
        slopes = np.zeros((*offset.shape, 6))
        slopes[:, :, 0] = np.cross(-east, from_centre) / site.meridian_radius_m[:, None]
        parallel_m = site.normal_radius_m * np.cos(self.places.latitude_rad)
        slopes[:, :, 1] = np.cross(pole, position) / parallel_m[:, None]
        slopes[:, :, 3] = np.cross(-up, offset)
        return slopes


class LaunchInformation:
    """Fisher information (n, 6, 6) of launches, from looks at equal steps of the burn.

    A look without a bias adds SᵀWS with the slopes S of its step and W = w (1 - u uᵀ)/r². W is
    added up over sensors, and multiplied by slopes once a step.
    """

    def __init__(self, slopes: Sequence[NDArray[np.floating]]) -> None:
        self._slopes = slopes
        self._across = np.zeros((len(slopes), len(_PAIRS), len(slopes[0])))
        self._lost: FloatArray | float = 0.0

    def add(
        self,
        step: int,
        rows: IntArray,
        direction: FloatArray,
        range_m: FloatArray,
        weight: FloatArray,
    ) -> None:
        """Add looks at cells `rows` (n,): unit directions (n, 3), ranges, weights 1/σ² (n,)."""
        share = weight / np.square(range_m)
        unit = np.ascontiguousarray(direction.T)
        for place, (row, column) in enumerate(_PAIRS):
            self._across[step, place, rows] += share * (
                float(row == column) - unit[row] * unit[column]
            )

    def lose(self, bias: "BiasInformation", sigma_rad: float) -> None:
        """Subtract the information lost to the unknown pointing bias of a sensor."""
        shared = bias.information + np.eye(3) / sigma_rad**2
        self._lost = self._lost + np.matmul(
            bias.cross_information,
            np.linalg.solve(shared, bias.cross_information.mT),
        )

    def whole(self) -> FloatArray:
        """Return the information (n, 6, 6)."""
        information = np.zeros((self._across.shape[2], 6, 6))
        for slopes, across in zip(self._slopes, self._across, strict=True):
            weighed = np.matmul(across[_MATRIX].transpose(2, 0, 1), slopes)
            information += np.matmul(slopes.mT, weighed)
        return information - self._lost

    def covariance(self) -> FloatArray:
        """Return the bounds' covariances (n, 6, 6) in units of `_SCALES`; nan if not observable."""
        values, vectors = np.linalg.eigh(self.whole())
        is_known = values[:, 0] > _LEAST_INFORMATION * np.maximum(values[:, -1], 1e-300)
        with np.errstate(divide="ignore", invalid="ignore"):
            covariance = np.matmul(vectors / values[:, None, :], vectors.mT)
        return np.where(is_known[:, None, None], covariance, np.nan)


class BiasInformation:
    """Fisher information (n, 3, 3) of a sensor's pointing bias, and (n, 6, 3) with the launch's."""

    def __init__(self, cells: int) -> None:
        self.information = np.zeros((cells, 3, 3))
        self.cross_information = np.zeros((cells, 6, 3))

    def add(
        self,
        rows: IntArray,
        slopes: NDArray[np.floating],
        direction: FloatArray,
        range_m: FloatArray,
        weight: FloatArray,
    ) -> None:
        """Add looks at cells `rows` (n,) with slopes (n, 3, 6), as `LaunchInformation.add`."""
        along = np.matmul(direction[:, None, :], slopes)
        across = slopes - direction[:, :, None] * along
        self.cross_information[rows] += across.mT * (weight / range_m)[:, None, None]
        self.information[rows] += (
            np.eye(3) - direction[:, :, None] * direction[:, None, :]
        ) * weight[:, None, None]


@frozen(eq=False)
class BurnoutBounds:
    """Root-mean-square bounds (n,) of launch point, velocity at burnout, and impact point."""

    launch_m: FloatArray
    velocity_m_s: FloatArray
    impact_m: FloatArray


@frozen(eq=False)
class BurnSlopes:
    """Slopes (n, 3, 6) of launches at equal steps of the burn, and `LaunchSlopes.at_burnout`."""

    moved: Sequence[NDArray[np.float32]]
    burnout: tuple[FloatArray, FloatArray, FloatArray, FloatArray]

    @classmethod
    def of(cls, slopes: LaunchSlopes, samples: int) -> "BurnSlopes":
        """Return the derivatives at ends of parts of the burn."""
        since_s = np.linspace(0.0, slopes.places.profile.burn_time_s, samples + 1).tolist()
        return cls(
            [slopes.at(time_s).astype(np.float32) for time_s in since_s], slopes.at_burnout()
        )


def burnout_bounds(
    burnout: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    covariance: FloatArray,
    *,
    comes_down: bool,
) -> BurnoutBounds:
    """Return the bounds of launches with covariances (n, 6, 6) of their unknowns.

    Bounds of impacts are nan where the impact may be anywhere on Earth. `burnout` is as
    `LaunchSlopes.at_burnout` returns it.
    """
    position, velocity, moved, turned = burnout
    launch_m = np.sqrt(
        covariance[:, 0, 0] * _SCALES[0] ** 2 + covariance[:, 1, 1] * _SCALES[1] ** 2
    )
    impact_m = np.full(len(launch_m), np.nan)
    if comes_down:
        impact_m = _spread(_impact_slopes(position, velocity, moved, turned), covariance)
        impact_m = np.where(impact_m < _ANYWHERE_M, impact_m, np.nan)
    return BurnoutBounds(launch_m, _spread(turned, covariance), impact_m)


def _spread(slopes: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return √tr(G P Gᵀ) (n,)."""
    return np.sqrt(np.einsum("nij,njk,nik->n", slopes, covariance, slopes, optimize=True))


def _impact_slopes(
    position: FloatArray, velocity: FloatArray, moved: FloatArray, turned: FloatArray
) -> FloatArray:
    """Return derivatives (n, 3, 6) of impact points in ECEF, by central differences."""
    slopes = np.zeros(moved.shape)
    for column in (0, 1, 3, 4, 5):
        position_step = moved[:, :, column]
        velocity_step = turned[:, :, column]
        forward, backward = (
            _impacts(position + sign * position_step, velocity + sign * velocity_step)
            for sign in (0.05, -0.05)
        )
        slopes[:, :, column] = (forward - backward) / 0.1
    return slopes


def _impacts(position: FloatArray, velocity: FloatArray) -> FloatArray:
    """Return impact points (n, 3) in ECEF of free flights from states (n, 3) in ECEF."""
    spin = EARTH_ROTATION_RAD_S
    inertial = velocity + spin * np.stack(
        [-position[:, 1], position[:, 0], np.zeros(len(position))], axis=1
    )
    time_s, point = kepler_impact(position, inertial)
    cosine = np.cos(spin * time_s)
    sine = np.sin(spin * time_s)
    x, y, z = point.T
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, z], axis=1)
