"""The detection model `snr`: from intensity, transmittance and noise to P_d, and the measurements
of detections.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from attrs import frozen
from scipy.special import ndtr

from opir_core.arrays import ByteArray, FloatArray, IndexArray, IntArray
from opir_core.errors import Problem
from opir_core.geometry import components, length
from opir_core.planning import blocks
from opir_core.plugin import (
    Band,
    DetectionProbability,
    Exposures,
    Measured,
    ModelContext,
    RandomDraws,
    Response,
    Sensor,
    Views,
)
from opir_photons.columns import as_slice_if_consecutive
from opir_photons.detection.configs import SnrConfig
from opir_photons.detection.confirmation import false_confirmation_probability, gate_radius_cells
from opir_photons.detection.focal_planes import LineOfSightError
from opir_photons.detection.own_past import subtract_own_past
from opir_photons.detection.radiometric_columns import (
    checked_intensities,
    checked_radiances_and_clutter,
    checked_transmittances,
    require_radiance,
)
from opir_photons.detection.receivers import (
    Receiver,
    Rule,
    by_number,
    noise_chance,
    noise_w_m2,
    photon_noise_w_m2,
    receivers_of,
)
from opir_photons.detection.rejection_sampling import accepted_draws
from opir_photons.detection.scan_correlation import scan_correlation
from opir_photons.environment import RadiometricEnvironment, heights_m, make_environment


@frozen(eq=False)
class MeasuredColumns:
    """Columns of measurements, filled by kinds of receivers; nan beyond a sensor's bands."""

    bands: ByteArray
    snr: FloatArray
    sigma_rad: FloatArray
    irradiance_w_m2: FloatArray

    @classmethod
    def of(cls, rows: int, width: int) -> "MeasuredColumns":
        """Return empty columns."""
        return cls(
            np.empty(rows, np.uint8), np.empty(rows), np.empty(rows), np.empty((rows, width))
        )

    def measured(self, noise_w_m2: FloatArray) -> Measured:
        """Return the measurements, with the noise (n, B)."""
        return Measured(self.bands, self.snr, self.sigma_rad, self.irradiance_w_m2, noise_w_m2)

    def put(
        self,
        rows: slice | IntArray,
        measured: FloatArray,
        noise: FloatArray,
        rule: Rule,
        slopes: FloatArray,
        error: LineOfSightError,
    ) -> None:
        """Fill rows with the signals (n, B) of one kind of receiver, in standard deviations of the
        noise (n, B).
        """
        width = measured.shape[1]
        strength = rule.strength(measured, slopes)
        self.bands[rows] = rule.confirming(measured)
        self.snr[rows] = strength
        self.sigma_rad[rows] = error.sigma_rad(measured, noise, strength)
        for band in range(width):
            self.irradiance_w_m2[rows, band] = measured[:, band] * noise[:, band]
        self.irradiance_w_m2[rows, width:] = np.nan


#: Numbers of receivers that measure alike, each with the rows of its looks.
RowsOfKind = Sequence[tuple[int, slice | IntArray]]


@frozen(eq=False)
class SnrDetection(DetectionProbability):
    """SNR in each band, and the sensor's rule over its bands; see docs/explanation/detection.md.

    `width` is the largest number of bands of a sensor; `twin` (sensors,) the first sensor with an
    equal receiver; `count_w_m2` (sensors, width) the irradiance of one photon; `floor_rad`
    (sensors,) the least line-of-sight sigma; `dark_noise_w_m2` (sensors, width) the noise with a
    dark background, 1 beyond a sensor's bands; `noise_chance` (sensors,) the false-alarm
    probability per resolution cell and look, `confirmation` (sensors, 2) M and N of the
    confirmation over scans, `rate_per_scan` (sensors,) the mean number of confirmed false alarms
    per scan, `false_again` (sensors,) the probability that one is followed by another near it
    within N scans.
    """

    environment: RadiometricEnvironment
    receivers: tuple[Receiver, ...]
    width: int
    twin: IndexArray
    count_w_m2: FloatArray
    floor_rad: FloatArray
    ifov_rad: FloatArray
    dark_noise_w_m2: FloatArray
    noise_chance: FloatArray
    confirmation: IntArray
    rate_per_scan: FloatArray
    false_again: FloatArray
    probability_tolerance: float | None
    needs_geometry: bool = True
    warnings: tuple[Problem, ...] = ()

    @property
    def uses_seed(self) -> bool:
        """Whether its atmosphere does."""
        return self.environment.atmosphere.uses_seed

    def probability(self, exposures: Exposures) -> FloatArray:
        """Return the probability of detection of each look."""
        return ndtr(self.response(exposures).probit)

    def response(self, exposures: Exposures, *, slack: float = 0.0) -> Response:
        """Return the expected measurements of looks, with P_d to within `slack`."""
        rows_of_kind = by_number(self.twin[exposures.sensor], len(self.receivers))
        signal = self._irradiance_w_m2(exposures, rows_of_kind)
        self._subtract_own_past(signal, exposures, rows_of_kind)
        noise = self._noise_w_m2(exposures, rows_of_kind, signal)
        # Its square is still a double.
        snr = np.minimum(signal / noise, 1e100)
        sine = exposures.elevation_sine
        quantile = np.empty(len(exposures))
        for number, rows in rows_of_kind:
            receiver = self.receivers[number]
            width = len(receiver.bands)
            expected = snr[:width, rows].T
            slopes = receiver.slopes(expected, noise[:width, rows].T, sine[rows])
            quantile[rows] = receiver.quantile(expected, slopes, slack)
        return Response(quantile, snr.T, noise.T, sine)

    def breakpoints_s(self) -> FloatArray:
        """Return the scene times (targets, k) at which signals may jump or bend."""
        ignition_s = self.environment.targets.ignition_s[:, None]
        # From one lag after ignition on a frame difference subtracts a target's own light.
        planes = [receiver.plane for receiver in self.receivers]
        lags_s = {plane.frames.lag_s for plane in planes if plane is not None and plane.frames}
        times_s = [self.environment.breakpoints_s()]
        times_s += [ignition_s + lag_s for lag_s in sorted(lags_s)]
        return np.concatenate(times_s, axis=1)

    def transmittance(self, exposures: Exposures, band: Band) -> FloatArray:
        """Return the transmittances (n,) in a band between the targets and the sensors of looks."""
        number = self.environment.bands.index(band)
        return self.environment.atmosphere.transmittance(number, self.environment.paths(exposures))

    def measure(self, exposures: Exposures, rng: RandomDraws) -> Measured:
        """Return the measurements of looks that detected."""
        return self.measure_response(self.response(exposures), exposures.sensor, rng)

    def measure_response(
        self,
        response: Response,
        sensor: IndexArray,
        rng: RandomDraws,
        probability: FloatArray | None = None,
    ) -> Measured:
        """Return measurements conditional on the detection: a free draw, or another if that does
        not detect.
        """
        columns = MeasuredColumns.of(len(sensor), self.width)
        chances = _Chances(response.probit, probability)
        for number, rows in by_number(self.twin[sensor], len(self.receivers)):
            failed = [
                self._measure_once(number, block, response, rng, columns) for block in _blocks(rows)
            ]
            rejected = np.concatenate(failed)
            if len(rejected):
                # The bits of a uniform number are exact on every platform, those of a normal number
                # are not.
                uniforms = rng.take(rejected).uniforms("further measurements")
                expected = self._expected(number, rejected, response)
                self._measure_again(
                    number, rejected, expected, chances.of(rejected), uniforms, columns
                )
        return columns.measured(response.noise_w_m2)

    def _expected(
        self, number: int, rows: slice | IntArray, response: Response
    ) -> "_ExpectedSignals":
        """Return the expected signals of rows of one kind of receiver."""
        receiver = self.receivers[number]
        width = len(receiver.bands)
        snr = response.snr[rows, :width]
        noise = response.noise_w_m2[rows, :width]
        return _ExpectedSignals(snr, noise, receiver.slopes(snr, noise, response.sine(rows)))

    def _measure_once(
        self,
        number: int,
        rows: slice | IntArray,
        response: Response,
        rng: RandomDraws,
        columns: MeasuredColumns,
    ) -> IntArray:
        """Fill rows with free draws; return the rows of those that do not detect."""
        rule = self.receivers[number].rule
        # Added in place: half the time, since the columns stay in the processor's cache.
        measured = rng.take(rows).normals("measurement", len(self.receivers[number].bands))
        snr, noise, slopes = self._expected(number, rows, response)
        measured += snr
        failed = np.flatnonzero(~rule.passes(measured, slopes))
        columns.put(rows, measured, noise, rule, slopes, self._line_of_sight_error(number))
        return rows.start + failed if isinstance(rows, slice) else rows[failed]

    def _measure_again(
        self,
        number: int,
        rows: slice | IntArray,
        expected: "_ExpectedSignals",
        chance: FloatArray,
        uniforms: FloatArray,
        columns: MeasuredColumns,
    ) -> None:
        """Fill rows with draws that detect, of looks with P_d (n,), from the first column of
        `uniforms`.
        """
        rule = self.receivers[number].rule
        seeds = np.ascontiguousarray(uniforms[:, 0]).view(np.uint64)
        snr, noise, slopes = expected
        measured = accepted_draws(rule, snr, slopes, chance, seeds)
        columns.put(rows, measured, noise, rule, slopes, self._line_of_sight_error(number))

    @property
    def words(self) -> int:
        """Number of random numbers per false alarm: one, the seed of the others."""
        return 1

    def measure_noise(self, sensor: IndexArray, uniforms: FloatArray) -> Measured:
        """Return the measurements (n,) of false alarms, with a dark background."""
        columns = MeasuredColumns.of(len(sensor), self.width)
        for number, rows in by_number(self.twin[sensor], len(self.receivers)):
            expected = self._without_signals(number, len(uniforms[rows]))
            chance = np.full(len(expected.snr), self.noise_chance[number])
            self._measure_again(number, rows, expected, chance, uniforms[rows], columns)
        return columns.measured(self.dark_noise_w_m2[sensor])

    def _without_signals(self, number: int, count: int) -> "_ExpectedSignals":
        """Return no signals in the noise of one kind of receiver with a dark background."""
        receiver = self.receivers[number]
        snr = np.zeros((count, len(receiver.bands)))
        noise = np.broadcast_to(self.dark_noise_w_m2[number, : snr.shape[1]], snr.shape)
        return _ExpectedSignals(snr, noise, receiver.slopes(snr, noise, np.ones(count)))

    def _irradiance_w_m2(self, exposures: Exposures, rows_of_kind: RowsOfKind) -> FloatArray:
        """Return the irradiances (B, n) of targets at the aperture, W/m²; 0 beyond a sensor's
        bands.
        """
        paths = self.environment.paths(exposures)
        aspect = self.environment.aspect_rad(exposures)
        irradiance = np.zeros((self.width, len(exposures)))
        for number, rows in rows_of_kind:
            looks = exposures.take(rows)
            path = paths.take(rows)
            bands = self.receivers[number].bands.tolist()
            intensity = self.environment.intensities_w_sr(bands, looks, path.height_m, aspect[rows])
            checked_intensities(intensity, len(bands), len(looks))
            shining = as_slice_if_consecutive(np.flatnonzero(np.any(intensity > 0.0, axis=0)))
            received = intensity[:, shining] / np.square(looks.range_m[shining])
            air = checked_transmittances(self.environment.atmosphere, bands, path.take(shining))
            received *= air
            lit = np.zeros(intensity.shape)
            lit[:, shining] = received
            irradiance[: len(bands), rows] = lit
        return irradiance

    def _subtract_own_past(
        self, signal: FloatArray, exposures: Exposures, rows_of_kind: RowsOfKind
    ) -> None:
        """Subtract from signals (B, n), in place, the targets' own light in frame differences."""
        for number, rows in rows_of_kind:
            plane = self.receivers[number].plane
            if plane is None or plane.frames is None:
                continue
            looks = exposures.take(rows)
            signals = signal[:, rows]

            def irradiance_of(earlier: Exposures, number: int = number) -> FloatArray:
                return self._irradiance_w_m2(earlier, [(number, slice(0, len(earlier)))])

            subtract_own_past(signals, looks, plane, self.environment, irradiance_of)
            signal[:, rows] = signals

    def line_of_sight_sigma_rad(self, response: Response, sensor: IndexArray) -> FloatArray:
        """Return the standard deviations (n,) per axis of lines of sight with the expected signals;
        inf without one.
        """
        sigma_rad = np.empty(len(sensor))
        for number, rows in by_number(self.twin[sensor], len(self.receivers)):
            width = len(self.receivers[number].bands)
            snr = response.snr[rows, :width]
            noise = response.noise_w_m2[rows, :width]
            with np.errstate(divide="ignore"):
                error = self._line_of_sight_error(number)
                sigma_rad[rows] = error.sigma_rad(snr, noise, snr.max(axis=1))
        return sigma_rad

    def focal_plane_figures(
        self, sensors: Sequence[Sensor], looks: Exposures
    ) -> Iterator[Mapping[str, Any]]:
        """Yield the figures of each sensor's focal plane by band, as plain values, with the least
        and the largest noise of looks over the NEI; nothing for sensors without a focal plane."""
        noise_w_m2 = self.response(looks).noise_w_m2
        for number, (sensor, receiver) in enumerate(zip(sensors, self.receivers, strict=True)):
            if receiver.plane is None:
                continue
            sensor_noise_w_m2 = noise_w_m2[looks.sensor == number]
            saturation_w_m2 = receiver.plane.saturation_w_m2(0.0)[:, 0]
            for place, nei_w_m2 in enumerate(receiver.radiometer.nei_w_m2):
                ratio = sensor_noise_w_m2[:, place] / nei_w_m2
                yield {
                    "sensor_id": sensor.id,
                    "band": sensor.bands[place].name,
                    "nei_w_m2": nei_w_m2,
                    "share_in_pixel": float(receiver.plane.peak_share[place]),
                    "saturation_w_m2": float(saturation_w_m2[place]),
                    "least_noise_over_nei": float(ratio.min()) if len(ratio) else None,
                    "largest_noise_over_nei": float(ratio.max()) if len(ratio) else None,
                }

    def shortfall_text(self, look: Exposures) -> str:
        """Return a text of the factor by which a look is below its threshold: the signal is that of
        one band with the same P_d.
        """
        receiver = self.receivers[self.twin[look.sensor[0]]]
        response = self.response(look)
        assert response.probit is not None
        threshold = receiver.radiometer.threshold
        if response.snr.max() >= threshold:
            return "rejected by the sensor's rule over bands"
        signal = float(response.probit[0]) + threshold
        # Below 0.05 standard deviations of noise there is next to no signal.
        factor = threshold / max(signal, 0.05)
        bound = "at best" if signal > 0.05 else "more than"
        times = f"{bound} {factor:.{2 if factor < 100.0 else 3}g} times"
        return f"{times} below the threshold of {threshold:g} sigma"

    def _line_of_sight_error(self, number: int) -> LineOfSightError:
        return LineOfSightError(
            self.floor_rad[number], self.ifov_rad[number], self.receivers[number].plane
        )

    def _noise_w_m2(
        self, exposures: Exposures, rows_of_kind: RowsOfKind, signal_w_m2: FloatArray
    ) -> FloatArray:
        """Return the noise (B, n) at the aperture, W/m²; 1 beyond a sensor's bands.

        Signals (B, n) of sensors with a focal plane are limited, in place, to those that fill a
        well.
        """
        noise = np.ascontiguousarray(self.dark_noise_w_m2.T).take(exposures.sensor, axis=1)
        has_background = self.environment.has_background
        view = self.environment.views(exposures) if has_background else None
        for number, rows in rows_of_kind:
            receiver = self.receivers[number]
            pixel_sr = self.ifov_rad[number] ** 2
            width = len(receiver.bands)
            behind = np.zeros((width, 1))
            if view is not None:
                sensor_ecef_m = exposures.sensor_ecef_m[rows]
                radiance, clutter = self._background(receiver, view.take(rows), sensor_ecef_m)
                behind = radiance * pixel_sr
                photons = photon_noise_w_m2(behind, self.count_w_m2[number, :width, None])
                noise[:width, rows] = noise_w_m2(noise[:width, rows], photons, clutter * pixel_sr)
            if receiver.plane is not None:
                limit = receiver.plane.saturation_w_m2(behind)
                signal_w_m2[:width, rows] = np.minimum(signal_w_m2[:width, rows], limit)
        return noise

    def _background(
        self, receiver: Receiver, view: Views, sensor_ecef_m: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return radiances and clutter in a pixel (B, n), W m⁻² sr⁻¹, as a receiver's filters leave
        it.
        """
        background = self.environment.background
        bands = receiver.bands.tolist()
        if receiver.plane is None or not background.structures:
            return checked_radiances_and_clutter(background, bands, view)
        radiance, rms, structure = background.structured_radiances_w_m2_sr(bands, view)
        for column in (radiance, rms):
            require_radiance(column, len(bands), view, "structured_radiances_w_m2_sr")
        range_m = length(*components(view.point_ecef_m - sensor_ecef_m))
        return radiance, receiver.plane.clutter_w_m2_sr(rms, structure, range_m)


def snr_detection(config: SnrConfig, context: ModelContext) -> SnrDetection:
    """Return the detection model `snr`; raises `ModelError` for sensors without a radiometer."""
    assert context.surroundings is not None
    environment = make_environment(context.surroundings)
    receivers = receivers_of(context.sensors, environment, config)
    half_angle = np.array([sensor.field_of_regard_half_angle_rad for sensor in context.sensors])
    floor_rad = np.array([sensor.line_of_sight_sigma_rad for sensor in context.sensors])
    ifov_rad = np.array([receiver.radiometer.ifov_rad for receiver in receivers])
    chances = _noise_chances(receivers)
    confirmed, repeated = _confirmed(context.sensors, receivers, environment, chances)
    confirmation = [receiver.radiometer.confirmation for receiver in receivers]
    return SnrDetection(
        environment=environment,
        receivers=tuple(receivers),
        width=max(len(receiver.bands) for receiver in receivers),
        twin=_twins(receivers, floor_rad),
        count_w_m2=_counts_w_m2(receivers),
        floor_rad=floor_rad,
        ifov_rad=ifov_rad,
        dark_noise_w_m2=_dark_noise_w_m2(receivers),
        noise_chance=chances,
        confirmation=np.array(confirmation, dtype=np.int64),
        rate_per_scan=chances * resolution_cells(half_angle, ifov_rad) * confirmed,
        false_again=repeated,
        probability_tolerance=None if config.exact else config.probability_tolerance,
        warnings=_blind_sensors(context.sensors, environment),
    )


def _noise_chances(receivers: Sequence[Receiver]) -> FloatArray:
    """Return the false-alarm probabilities (sensors,), worked out once for receivers of a kind."""
    logarithms = dict[tuple[Any, ...], float]()
    for receiver in receivers:
        if receiver.kind not in logarithms:
            logarithms[receiver.kind] = noise_chance(receiver)
    return np.exp(np.array([logarithms[receiver.kind] for receiver in receivers]))


def _blind_sensors(
    sensors: Sequence[Sensor], environment: RadiometricEnvironment
) -> tuple[Problem, ...]:
    """Return a warning of sensors DSP with the paper's long-wave band, whose clutter and warm
    optics hide launches.
    """
    blind = [sensor for sensor in sensors if sensor.type == "DSP" and _is_long_wave(sensor)]
    if not blind or not environment.has_background:
        return ()
    sensor, *further = blind
    listed = f"{sensor.id} and {len(further)} more" if further else sensor.id
    words = (
        f"{listed}: this DSP is the paper's ({', '.join(band.name for band in sensor.bands)},"
        f" {sensor.scan.period_ns * 1e-9:g} s), which sees no launch before the Earth, by day or by"
        " night; that of the public record (2.7 and 4.3 um, 10 s) is preset: heritage"
    )
    return (Problem("detection", words),)


def _is_long_wave(sensor: Sensor) -> bool:
    """Whether a sensor has a focal plane and long-wave bands alone, in which plumes are before the
    Earth's own emission, not reflected sunlight.
    """
    has_plane = sensor.radiometer is not None and bool(sensor.radiometer.focal_planes)
    return has_plane and min(band.lower_um for band in sensor.bands) >= 5.0


def resolution_cells(half_angle_rad: FloatArray, ifov_rad: FloatArray) -> FloatArray:
    """Return the numbers of resolution cells in cones of half angles (n,): their solid angle over
    the IFOV squared.
    """
    return 4.0 * np.pi * np.square(np.sin(0.5 * half_angle_rad) / ifov_rad)


def _confirmed(
    sensors: Sequence[Sensor],
    receivers: Sequence[Receiver],
    environment: RadiometricEnvironment,
    chances: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the probabilities (sensors,) that a false alarm is confirmed, and that it is followed
    by another.

    Confirmation gates and the correlation of clutter are those at the range straight down.
    """
    confirmed = np.ones(len(sensors))
    repeated = np.empty(len(sensors))
    for number, (sensor, receiver) in enumerate(zip(sensors, receivers, strict=True)):
        radiometer = receiver.radiometer
        chance = float(chances[number])
        needed, scans = radiometer.confirmation
        height_m = float(heights_m(sensor.orbit.position_ecef_m(np.zeros(1)))[0])
        period_s = sensor.scan.period_ns * 1e-9
        speed_m_s = radiometer.confirmation_speed_m_s
        scans_before = np.arange(1.0, max(scans, 2))
        radius = gate_radius_cells(scans_before, period_s, radiometer.ifov_rad, height_m, speed_m_s)
        correlation = scan_correlation(sensor, receiver, environment, period_s * scans_before)
        repeated[number] = false_confirmation_probability(chance, 2, radius, correlation)
        if needed > 1:
            confirmed[number] = false_confirmation_probability(chance, needed, radius, correlation)
    return confirmed, repeated


class _Chances(NamedTuple):
    """Probabilities of detection, given by their quantiles or directly."""

    probit: FloatArray | None
    probability: FloatArray | None

    def of(self, rows: IntArray) -> FloatArray:
        """Return the probabilities of some rows."""
        if self.probability is not None:
            return self.probability[rows]
        assert self.probit is not None
        return ndtr(self.probit[rows])


class _ExpectedSignals(NamedTuple):
    """Expected signals and noise, W/m² (n, B), of one kind of receiver, and its rule's slopes."""

    snr: FloatArray
    noise_w_m2: FloatArray
    slopes: FloatArray


def _blocks(rows: slice | IntArray) -> list[slice | IntArray]:
    """Return rows divided into blocks with columns that fit a processor's cache."""
    if isinstance(rows, slice):
        return [
            slice(rows.start + block.start, rows.start + block.stop)
            for block in blocks(rows.stop - rows.start)
        ]
    return [rows[block] for block in blocks(len(rows))]


def _counts_w_m2(receivers: Sequence[Receiver]) -> FloatArray:
    places = range(max(len(receiver.bands) for receiver in receivers))
    return np.array([[receiver.count_w_m2(place) for place in places] for receiver in receivers])


def _dark_noise_w_m2(receivers: Sequence[Receiver]) -> FloatArray:
    noise = np.ones((len(receivers), max(len(receiver.bands) for receiver in receivers)))
    for number, receiver in enumerate(receivers):
        noise[number, : len(receiver.bands)] = noise_w_m2(receiver.nei_w_m2)
    return noise


def _twins(receivers: Sequence[Receiver], floor_rad: FloatArray) -> IndexArray:
    """Return the number (sensors,) of the first receiver equal to each one."""
    numbers = dict[tuple[Any, ...], int]()
    kinds = [
        (*receiver.kind, floor)
        for receiver, floor in zip(receivers, floor_rad.tolist(), strict=True)
    ]
    return np.array(
        [numbers.setdefault(kind, number) for number, kind in enumerate(kinds)], dtype=np.int32
    )
