"""The detection model `snr`: from intensity, air, aperture and noise to the probability of detection.

What detections measure, filled in kind of sensor by kind of sensor.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from attrs import frozen
from numpy.typing import NDArray

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.detection.configs import SnrConfig
from opir_core.detection.receivers import (
    Receiver,
    Rule,
    by_number,
    noise_chance,
    noise_w_m2,
    photon_noise_w_m2,
    receivers_of,
)
from opir_core.detection.redrawing import measured_to_pass
from opir_core.interfaces.contexts import ModelContext
from opir_core.interfaces.optional import Response
from opir_core.interfaces.protocols import Measured, RandomDraws
from opir_core.interfaces.records import Exposures
from opir_core.planning.environment import RadiometricEnvironment
from opir_core.planning.looks import blocks
from opir_core.radiometry.long_paths import as_slice_if_consecutive
from opir_core.radiometry.protocols import radiances_and_clutter_w_m2_sr, transmittances


@frozen(eq=False)
class MeasuredColumns:
    """Measurements that are filled in kind by kind; nan beyond a sensor's bands."""

    bands: NDArray[np.uint8]
    snr: FloatArray
    sigma_rad: FloatArray
    irradiance_w_m2: FloatArray

    @classmethod
    def of(cls, rows: int, width: int) -> "MeasuredColumns":
        """Return columns of so many rows, still to be filled."""
        return cls(np.empty(rows, np.uint8), np.empty(rows), np.empty(rows), np.empty((rows, width)))

    def measured(self, noise_w_m2: FloatArray) -> Measured:
        """Return what was filled in, with the noise (n, B) it was measured in."""
        return Measured(self.bands, self.snr, self.sigma_rad, self.irradiance_w_m2, noise_w_m2)

    def put(
        self,
        rows: slice | IntArray,
        measured: FloatArray,
        noise: FloatArray,
        rule: Rule,
        floor_and_ifov_rad: tuple[float, float],
    ) -> None:
        """Fill in what one kind measured, in standard deviations (n, B) of the noise (n, B), in some of the rows."""
        width, best = measured.shape[1], measured[:, 0].copy()
        for band in range(1, width):
            np.maximum(best, measured[:, band], out=best)
        self.bands[rows], self.snr[rows] = rule.confirming(measured), best
        floor_rad, ifov_rad = floor_and_ifov_rad
        spread = ifov_rad / best
        spread *= spread
        spread += floor_rad * floor_rad
        self.sigma_rad[rows] = np.sqrt(spread, out=spread)
        for band in range(width):
            self.irradiance_w_m2[rows, band] = measured[:, band] * noise[:, band]
        self.irradiance_w_m2[rows, width:] = np.nan


#: Numbers of receivers that measure alike, each with the rows of its looks.
RowsOfKind = Sequence[tuple[int, slice | IntArray]]

#: Signals over noise are held within it: its square is still a double.
_MOST_SNR = 1e100


@frozen(eq=False)
class SnrDetection:
    """Signal over noise in each band, and the sensor's rule over its bands; see docs/explanation/detection.md.

    `width` is the largest number of bands of the sensors; `alike` (sensors,) the first of those that measure as each
    does; `count_w_m2` (sensors, width) what one photon in a band stands for; `floor_rad` (sensors,) the spread of lines
    of sight that no signal betters; `dark_noise_w_m2` (sensors, width) the noise before a dark background, 1 beyond a
    sensor's bands; `noise_chance` (sensors,) the chance that it alone crosses in a resolution cell and look,
    `rate_per_scan` (sensors,) how often it does on the mean in a scan.
    """

    scenery: RadiometricEnvironment
    receivers: tuple[Receiver, ...]
    width: int
    alike: IndexArray
    count_w_m2: FloatArray
    floor_rad: FloatArray
    ifov_rad: FloatArray
    dark_noise_w_m2: FloatArray
    noise_chance: FloatArray
    rate_per_scan: FloatArray
    probability_tolerance: float | None
    needs_geometry: bool = True

    def pair_probability(self, sensor: IndexArray, target: IndexArray) -> FloatArray | None:
        """Return None: probabilities vary from look to look."""
        return None

    def probability(self, exposures: Exposures) -> FloatArray:
        """Return the probability of detection of each look."""
        from scipy.special import ndtr

        chance: FloatArray = ndtr(self.response(exposures).probit)
        return chance

    def response(self, exposures: Exposures, *, slack: float = 0.0) -> Response:
        """Return what looks would measure; with a `slack`, probabilities may be off by as much."""
        rows_of_kind = by_number(self.alike[exposures.sensor], len(self.receivers))
        signal = self._irradiance_w_m2(exposures, rows_of_kind)
        noise = self._noise_w_m2(exposures, rows_of_kind)
        snr = np.minimum(signal / noise, _MOST_SNR)
        quantile = np.empty(len(exposures))
        for number, rows in rows_of_kind:
            receiver = self.receivers[number]
            width = len(receiver.bands)
            quantile[rows] = receiver.quantile(snr[:width, rows].T, noise[:width, rows].T, slack)
        return Response(quantile, snr.T, noise.T)

    def breakpoints_s(self) -> FloatArray:
        """Return when (targets, k), by scene time, signals may jump or bend, as far as the scenery says."""
        return self.scenery.breakpoints_s()

    def measure(self, exposures: Exposures, dice: RandomDraws) -> Measured:
        """Return what is measured in looks that detected."""
        return self.measure_response(self.response(exposures), exposures.sensor, dice)

    def measure_response(
        self, response: Response, sensor: IndexArray, dice: RandomDraws, probability: FloatArray | None = None
    ) -> Measured:
        """Return what is measured, conditional on the detection: where a free draw does not detect, another does."""
        found = MeasuredColumns.of(len(sensor), self.width)
        chance = _Chances(response.probit, probability)
        for number, rows in by_number(self.alike[sensor], len(self.receivers)):
            rule, spread = self.receivers[number].rule, (self.floor_rad[number], self.ifov_rad[number])
            width, failed, seeds = len(self.receivers[number].bands), [], []
            for part in _parts(rows):
                noise = response.noise_w_m2[part, :width]
                # Signals are added in place: what fits the processor's cache is done in half the time.
                measured = dice.take(part).normals("measurement", width)
                off = measured[:, 0].copy()
                measured += response.snr[part, :width]
                again = np.flatnonzero(~rule.passes(measured, noise))
                found.put(part, measured, noise, rule, spread)
                failed.append(_rows_of(part, again))
                seeds.append(off[again])
            left = np.concatenate(failed)
            if len(left):
                # Of a draw that failed nothing else is made: its bits, mixed well, seed the ones after it.
                snr, noise = response.snr[left, :width], response.noise_w_m2[left, :width]
                measured = measured_to_pass(rule, snr, noise, chance.of(left), np.concatenate(seeds).view(np.uint64))
                found.put(left, measured, noise, rule, spread)
        return found.measured(response.noise_w_m2)

    @property
    def words(self) -> int:
        """Return how many numbers an exceedance is drawn with: one, the seed of all that it takes."""
        return 1

    def measure_noise(self, sensor: IndexArray, uniforms: FloatArray) -> Measured:
        """Return what is measured (n,) where noise alone crossed, before a dark background."""
        found = MeasuredColumns.of(len(sensor), self.width)
        for number, rows in by_number(self.alike[sensor], len(self.receivers)):
            receiver = self.receivers[number]
            seeds = np.ascontiguousarray(uniforms[rows, 0]).view(np.uint64)
            nothing = np.zeros((len(seeds), len(receiver.bands)))
            noise = np.broadcast_to(self.dark_noise_w_m2[number, : nothing.shape[1]], nothing.shape)
            chance = np.full(len(seeds), self.noise_chance[number])
            measured = measured_to_pass(receiver.rule, nothing, noise, chance, seeds)
            found.put(rows, measured, noise, receiver.rule, (self.floor_rad[number], self.ifov_rad[number]))
        return found.measured(self.dark_noise_w_m2[sensor])

    def _irradiance_w_m2(self, exposures: Exposures, rows_of_kind: RowsOfKind) -> FloatArray:
        """Return the irradiances (B, n) of targets at the aperture; 0 beyond a sensor's bands."""
        paths, aspect = self.scenery.paths(exposures), self.scenery.aspect_rad(exposures)
        irradiance = np.zeros((self.width, len(exposures)))
        for number, rows in rows_of_kind:
            looks, path, bands = exposures.take(rows), paths.take(rows), self.receivers[number].bands.tolist()
            intensity = self.scenery.intensities_w_sr(bands, looks, path.height_m, aspect[rows])
            shining = as_slice_if_consecutive(np.flatnonzero(np.any(intensity > 0.0, axis=0)))
            own = intensity[:, shining] / np.square(looks.range_m[shining])
            own *= transmittances(self.scenery.atmosphere, bands, path.take(shining))
            lit = np.zeros(intensity.shape)
            lit[:, shining] = own
            irradiance[: len(bands), rows] = lit
        return irradiance

    def _noise_w_m2(self, exposures: Exposures, rows_of_kind: RowsOfKind) -> FloatArray:
        """Return the noise (B, n) at the aperture; 1 beyond a sensor's bands."""
        noise = np.ascontiguousarray(self.dark_noise_w_m2.T).take(exposures.sensor, axis=1)
        if not self.scenery.has_background:
            return noise
        view = self.scenery.views(exposures)
        for number, rows in rows_of_kind:
            bands, pixel_sr = self.receivers[number].bands.tolist(), self.ifov_rad[number] ** 2
            radiance, clutter = radiances_and_clutter_w_m2_sr(self.scenery.background, bands, view.take(rows))
            per_count = self.count_w_m2[number, : len(bands), None]
            photons = photon_noise_w_m2(radiance * pixel_sr, per_count)
            noise[: len(bands), rows] = noise_w_m2(noise[: len(bands), rows], photons, clutter * pixel_sr)
        return noise


def snr_detection(config: SnrConfig, context: ModelContext) -> SnrDetection:
    """Return the detection model `snr`; raises `ModelError` for sensors that do not say how they measure light."""
    assert context.make_environment is not None
    scenery = context.make_environment()
    receivers = receivers_of(context.sensors, scenery, config)
    half_angle = np.array([sensor.field_of_regard_half_angle_rad for sensor in context.sensors])
    ifov_rad = np.array([receiver.radiometer.ifov_rad for receiver in receivers])
    cells = 4.0 * np.pi * np.square(np.sin(0.5 * half_angle) / ifov_rad)
    one_of_kind = {receiver.kind: receiver for receiver in receivers}
    of_kind = {kind: noise_chance(receiver) for kind, receiver in one_of_kind.items()}
    chances = np.exp(np.array([of_kind[receiver.kind] for receiver in receivers]))
    floor_rad = np.array([sensor.line_of_sight_sigma_rad for sensor in context.sensors])
    return SnrDetection(
        scenery=scenery,
        receivers=tuple(receivers),
        width=max(len(receiver.bands) for receiver in receivers),
        alike=_alike(receivers, floor_rad),
        count_w_m2=_counts_w_m2(receivers),
        floor_rad=floor_rad,
        ifov_rad=ifov_rad,
        dark_noise_w_m2=_dark_noise_w_m2(receivers),
        noise_chance=chances,
        rate_per_scan=chances * cells,
        probability_tolerance=None if config.exact else config.probability_tolerance,
    )


class _Chances(NamedTuple):
    """Probabilities of detection by their quantiles, or themselves."""

    probit: FloatArray | None
    probability: FloatArray | None

    def of(self, rows: IntArray) -> FloatArray:
        """Return those of some rows."""
        from scipy.special import ndtr

        if self.probability is not None:
            return self.probability[rows]
        assert self.probit is not None
        chance: FloatArray = ndtr(self.probit[rows])
        return chance


def _parts(rows: slice | IntArray) -> list[slice | IntArray]:
    """Return rows cut into parts whose columns fit a processor's cache."""
    if isinstance(rows, slice):
        return [slice(rows.start + part.start, rows.start + part.stop) for part in blocks(rows.stop - rows.start)]
    return [rows[part] for part in blocks(len(rows))]


def _rows_of(part: slice | IntArray, some: IntArray) -> IntArray:
    """Return the rows that are some of a part's."""
    return part.start + some if isinstance(part, slice) else part[some]


def _counts_w_m2(receivers: Sequence[Receiver]) -> FloatArray:
    places = range(max(len(receiver.bands) for receiver in receivers))
    return np.array([[receiver.count_w_m2(place) for place in places] for receiver in receivers])


def _dark_noise_w_m2(receivers: Sequence[Receiver]) -> FloatArray:
    noise = np.ones((len(receivers), max(len(receiver.bands) for receiver in receivers)))
    for number, receiver in enumerate(receivers):
        noise[number, : len(receiver.bands)] = noise_w_m2(receiver.nei_w_m2)
    return noise


def _alike(receivers: Sequence[Receiver], floor_rad: FloatArray) -> IndexArray:
    """Return the number (sensors,) of the first receiver that measures as each one does."""
    first = dict[tuple[Any, ...], int]()
    kinds = [(*each.kind, floor) for each, floor in zip(receivers, floor_rad.tolist(), strict=True)]
    return np.array([first.setdefault(kind, number) for number, kind in enumerate(kinds)], dtype=np.int32)
