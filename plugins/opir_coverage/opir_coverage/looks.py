"""Looks at launches from a grid: P_d, sigmas of lines of sight, least intensities."""

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from attrs import fields, frozen
from scipy.special import ndtr, ndtri

from opir_core import Plan
from opir_core.arrays import FloatArray, IntArray
from opir_core.constants import SPEED_OF_LIGHT_M_S
from opir_core.flight import height_m as height_m_of
from opir_core.geometry import length
from opir_core.planning import Targets
from opir_core.plugin import Band, DetectionProbability, Exposures, Response, Sensor
from opir_coverage.grid import SeenPoints, dot
from opir_coverage.launches import GridLaunches, LaunchPlaces, detection_of
from opir_coverage.visibility import Fleet

#: Largest error of P_d of a look: the default `probability_tolerance` of runs.
_SLACK = 1e-4
#: Most looks that are computed together, for little memory.
_AT_ONCE = 16_384
#: Rules over bands with one threshold for all.
_ONE_THRESHOLD = ("likelihood", "none")


@frozen(eq=False)
class GridLooks:
    """Looks of one sensor at the launches `rows` (n,), at one instant.

    `probit` are normal quantiles of P_d, `sigma_rad` those of lines of sight, `direction` (n, 3) is
    from the target to the sensor, `least_w_sr` are the least intensities (n,) by band.
    """

    rows: IntArray
    probit: FloatArray
    sigma_rad: FloatArray
    range_m: FloatArray
    direction: FloatArray
    least_w_sr: Mapping[Band, FloatArray]

    @property
    def chance(self) -> FloatArray:
        """P_d (n,)."""
        return ndtr(self.probit)


class Salvo:
    """Launches of one class from every cell at one instant, and the scene's models for them."""

    def __init__(self, plan: Plan, places: LaunchPlaces, ignition_s: float) -> None:
        self.plan = plan
        self.places = places
        self.ignition_s = ignition_s
        self.path = places.path(ignition_s)
        self.detection: DetectionProbability
        self.targets: Targets
        self.detection, self.targets = detection_of(plan, GridLaunches.of(places, self.path))

    @cached_property
    def burn_s(self) -> float:
        """The time from ignition to burnout, s."""
        return self.places.profile.burn_time_s

    def state(self, since_s: float) -> tuple[FloatArray, FloatArray]:
        """Return ECEF positions and velocities (cells, 3) at a time since ignition, s."""
        everyone = np.arange(len(self.places))
        now_s = min(self.ignition_s + since_s, self.path.burnout_s)
        return self.path.state(everyone, np.full(len(everyone), now_s))

    def height_time_s(self, height_m: float) -> float:
        """Return the time since ignition, s, at which the burn reaches a height, or nan."""
        since_s = np.linspace(0.0, self.burn_s, 257)
        launch = np.zeros(len(since_s), dtype=np.int64)
        place = self.path.state(launch, np.minimum(self.ignition_s + since_s, self.path.burnout_s))[
            0
        ]
        height = height_m_of(place.T, 1.0 / length(*place.T))
        return float(np.interp(height_m, height, since_s, right=np.nan))

    def looks(
        self, fleet: Fleet, number: int, points: Sequence[SeenPoints], *, with_least: bool = False
    ) -> list[GridLooks]:
        """Return the looks of a sensor at launches (cells,) at points, by time of the fleet."""
        rows = [
            np.flatnonzero(fleet.seen(number, step, visible_points))
            for step, visible_points in enumerate(points)
        ]
        looks: list[GridLooks] = []
        for steps in _batches([len(visible_points) for visible_points in rows]):
            exposures = [
                _exposures(
                    number,
                    rows[step],
                    points[step],
                    fleet.position_m[number, step],
                    float(fleet.time_s[step]),
                )
                for step in steps
            ]
            looks += self._split(
                number, _joined(exposures), [rows[step] for step in steps], with_least=with_least
            )
        return looks

    def _split(
        self, number: int, exposures: Exposures, rows: Sequence[IntArray], *, with_least: bool
    ) -> Iterator[GridLooks]:
        """Yield the looks of several instants, one instant after another."""
        probit, sigma_rad, response = self._measured(exposures)
        least = (
            self._least(number, exposures, response) if with_least and response is not None else {}
        )
        direction = (exposures.sensor_ecef_m - exposures.target_ecef_m) / exposures.range_m[:, None]
        end = 0
        for step_rows in rows:
            rows_of_step = slice(end, end := end + len(step_rows))
            least_of_step = {band: values[rows_of_step] for band, values in least.items()}
            yield GridLooks(
                step_rows,
                probit[rows_of_step],
                sigma_rad[rows_of_step],
                exposures.range_m[rows_of_step],
                direction[rows_of_step],
                least_of_step,
            )

    def _measured(self, exposures: Exposures) -> tuple[FloatArray, FloatArray, Response | None]:
        """Return quantiles of P_d, sigmas of lines of sight, and the response with signals."""
        sensor = exposures.sensor
        model = self.detection
        sigma_rad = np.array(
            [candidate.line_of_sight_sigma_rad for candidate in self.plan.sensors]
        )[sensor]
        if not len(sensor):
            return np.empty(0), sigma_rad, None
        chance = model.pair_probability(sensor, exposures.target)
        if chance is not None:
            return ndtri(chance), sigma_rad, None
        response = model.response(exposures, slack=_SLACK)
        if response is None or response.probit is None:
            return ndtri(model.probability(exposures)), sigma_rad, response
        sigma: Any = getattr(model, "line_of_sight_sigma_rad", None)
        return response.probit, sigma_rad if sigma is None else sigma(response, sensor), response

    def _least(
        self, number: int, exposures: Exposures, response: Response
    ) -> dict[Band, FloatArray]:
        """Return the intensities (n,) at a sensor's threshold in one look, W/sr, by band."""
        sensor = self.plan.sensors[number]
        if sensor.radiometer is None:
            return {}
        least = {}
        thresholds = band_thresholds(sensor)
        for place, band in enumerate(sensor.bands):
            passed = self.detection.transmittance(exposures, band)
            if passed is None:
                continue
            with np.errstate(divide="ignore"):
                needed = (
                    thresholds[place]
                    * response.noise_w_m2[:, place]
                    * np.square(exposures.range_m)
                    / passed
                )
            least[band] = needed
        return least


def _batches(counts: Sequence[int]) -> Iterator[list[int]]:
    """Yield numbers of instants whose looks are computed together, within `_AT_ONCE` looks."""
    batch: list[int] = []
    for step, count in enumerate(counts):
        if batch and sum(counts[member] for member in batch) + count > _AT_ONCE:
            yield batch
            batch = []
        batch.append(step)
    yield batch


def _exposures(
    number: int, rows: IntArray, points: SeenPoints, sensor_m: FloatArray, now_s: float
) -> Exposures:
    """Return the looks of a sensor at some of the points, at one time."""
    place = points.position_m[rows]
    way = sensor_m - place
    range_m = np.sqrt(dot(way, way))
    return Exposures(
        time_s=now_s + range_m / SPEED_OF_LIGHT_M_S,
        emission_time_s=np.full(len(rows), now_s),
        scan=np.zeros(len(rows), dtype=np.int64),
        sensor=np.full(len(rows), number, dtype=np.int32),
        target=rows.astype(np.int32),
        range_m=range_m,
        elevation_sine=dot(points.up[rows], way) / range_m,
        target_ecef_m=place,
        sensor_ecef_m=np.broadcast_to(sensor_m, (len(rows), 3)),
    )


def _joined(looks: Sequence[Exposures]) -> Exposures:
    """Return looks at several instants as one."""
    names = [look.name for look in fields(Exposures) if look.init]
    return Exposures(
        **{name: np.concatenate([getattr(look, name) for look in looks]) for name in names}
    )


def band_thresholds(sensor: Sensor) -> FloatArray:
    """Return the signals over noise (B,) at the threshold of a look; it needs a radiometer.

    Rules over the sum or over any band have one threshold; where bands are compared, bands other
    than the reference have the threshold of coincidence.
    """
    radiometer = sensor.radiometer
    assert radiometer is not None
    needed = np.full(len(sensor.bands), radiometer.threshold)
    if sensor.spectral_discrimination not in _ONE_THRESHOLD:
        needed[np.arange(len(needed)) != radiometer.reference] = radiometer.coincidence
    return needed
