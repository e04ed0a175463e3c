"""The detection model `snr`: from intensity, transmittance and noise to P_d, and the measurements
of detections.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from attrs import frozen
from numpy.typing import NDArray
from scipy.special import ndtr

from opir_core.arrays import FloatArray, IndexArray, IntArray
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

    bands: NDArray[np.uint8]
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
        best = rule.strength(measured, slopes)
        self.bands[rows] = rule.confirming(measured)
        self.snr[rows] = best
        self.sigma_rad[rows] = error.sigma_rad(measured, noise, best)
        for band in range(width):
            self.irradiance_w_m2[rows, band] = measured[:, band] * noise[:, band]
        self.irradiance_w_m2[rows, width:] = np.nan


#: Numbers of receivers that measure alike, each with the rows of its looks.
RowsOfKind = Sequence[tuple[int, slice | IntArray]]

#: Wavelength, µm, from which the Earth's own emission, not reflected sunlight, is what plumes are
#: seen before.
_LONG_WAVE_UM = 5.0

#: Signal, in standard deviations of noise, below which there is next to none.
_FAINT = 0.05

#: Largest SNR: its square is still a double.
_MOST_SNR = 1e100


@frozen(eq=False)
class SnrDetection(DetectionProbability):
    """SNR in each band, and the sensor's rule over its bands; see docs/explanation/detection.md.

    `width` is the largest number of bands of a sensor; `alike` (sensors,) the first sensor with an
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
    alike: IndexArray
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
        rows_of_kind = by_number(self.alike[exposures.sensor], len(self.receivers))
        signal = self._irradiance_w_m2(exposures, rows_of_kind)
        self._subtract_own_past(signal, exposures, rows_of_kind)
        noise = self._noise_w_m2(exposures, rows_of_kind, signal)
        snr = np.minimum(signal / noise, _MOST_SNR)
        quantile = np.empty(len(exposures))
        for number, rows in rows_of_kind:
            receiver = self.receivers[number]
            width = len(receiver.bands)
            expected = snr[:width, rows].T
            slopes = receiver.slopes(
                expected, noise[:width, rows].T, exposures.elevation_sine[rows]
            )
            quantile[rows] = receiver.quantile(expected, slopes, slack)
        return Response(quantile, snr.T, noise.T, exposures.elevation_sine)

    def breakpoints_s(self) -> FloatArray:
        """Return the scene times (targets, k) at which signals may jump or bend."""
        known_s = self.environment.breakpoints_s()
        begins_s = self.environment.targets.ignition_s[:, None]
        # From one lag after ignition on a frame difference subtracts a target's own light.
        lags_s = {
            one.plane.frames.lag_s
            for one in self.receivers
            if one.plane is not None and one.plane.frames
        }
        return np.concatenate([known_s, *(begins_s + lag_s for lag_s in sorted(lags_s))], axis=1)

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
        found = MeasuredColumns.of(len(sensor), self.width)
        chance = _Chances(response.probit, probability)
        for number, rows in by_number(self.alike[sensor], len(self.receivers)):
            receiver = self.receivers[number]
            spread = self._line_of_sight_error(number)
            rule = receiver.rule
            width = len(receiver.bands)
            failed = []
            for part in _parts(rows):
                noise = response.noise_w_m2[part, :width]
                # Added in place: half the time, since the columns stay in the processor's cache.
                measured = rng.take(part).normals("measurement", width)
                snr = response.snr[part, :width]
                measured += snr
                slopes = receiver.slopes(snr, noise, response.sine(part))
                again = np.flatnonzero(~rule.passes(measured, slopes))
                found.put(part, measured, noise, rule, slopes, spread)
                failed.append(_rows_of(part, again))
            left = np.concatenate(failed)
            if len(left):
                # The bits of a uniform number are exact on every platform, those of a normal number
                # are not.
                seeds = np.ascontiguousarray(
                    rng.take(left).uniforms("further measurements")[:, 0]
                ).view(np.uint64)
                snr = response.snr[left, :width]
                noise = response.noise_w_m2[left, :width]
                slopes = receiver.slopes(snr, noise, response.sine(left))
                measured = accepted_draws(rule, snr, slopes, chance.of(left), seeds)
                found.put(left, measured, noise, rule, slopes, spread)
        return found.measured(response.noise_w_m2)

    @property
    def words(self) -> int:
        """Number of random numbers per false alarm: one, the seed of the others."""
        return 1

    def measure_noise(self, sensor: IndexArray, uniforms: FloatArray) -> Measured:
        """Return the measurements (n,) of false alarms, with a dark background."""
        found = MeasuredColumns.of(len(sensor), self.width)
        for number, rows in by_number(self.alike[sensor], len(self.receivers)):
            receiver = self.receivers[number]
            seeds = np.ascontiguousarray(uniforms[rows, 0]).view(np.uint64)
            nothing = np.zeros((len(seeds), len(receiver.bands)))
            noise = np.broadcast_to(self.dark_noise_w_m2[number, : nothing.shape[1]], nothing.shape)
            chance = np.full(len(seeds), self.noise_chance[number])
            slopes = receiver.slopes(nothing, noise, np.ones(len(seeds)))
            measured = accepted_draws(receiver.rule, nothing, slopes, chance, seeds)
            found.put(
                rows, measured, noise, receiver.rule, slopes, self._line_of_sight_error(number)
            )
        return found.measured(self.dark_noise_w_m2[sensor])

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
            own = intensity[:, shining] / np.square(looks.range_m[shining])
            own *= checked_transmittances(self.environment.atmosphere, bands, path.take(shining))
            lit = np.zeros(intensity.shape)
            lit[:, shining] = own
            irradiance[: len(bands), rows] = lit
        return irradiance

    def _subtract_own_past(
        self, signal: FloatArray, exposures: Exposures, rows_of_kind: RowsOfKind
    ) -> None:
        """Subtract from signals (B, n), in place, what frame differences do of the targets
        themselves.
        """
        for number, rows in rows_of_kind:
            plane = self.receivers[number].plane
            if plane is None or plane.frames is None:
                continue
            looks = exposures.take(rows)
            own = signal[:, rows]

            def irradiance_of(earlier: Exposures, number: int = number) -> FloatArray:
                return self._irradiance_w_m2(earlier, [(number, slice(0, len(earlier)))])

            subtract_own_past(own, looks, plane, self.environment, irradiance_of)
            signal[:, rows] = own

    def line_of_sight_sigma_rad(self, response: Response, sensor: IndexArray) -> FloatArray:
        """Return the standard deviations (n,) per axis of lines of sight with the expected signals;
        inf without one.
        """
        sigma_rad = np.empty(len(sensor))
        for number, rows in by_number(self.alike[sensor], len(self.receivers)):
            width = len(self.receivers[number].bands)
            snr = response.snr[rows, :width]
            noise = response.noise_w_m2[rows, :width]
            with np.errstate(divide="ignore"):
                sigma_rad[rows] = self._line_of_sight_error(number).sigma_rad(
                    snr, noise, snr.max(axis=1)
                )
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
            own = noise_w_m2[looks.sensor == number]
            for place, band in enumerate(sensor.bands):
                nei_w_m2 = receiver.radiometer.nei_w_m2[place]
                yield {
                    "sensor_id": sensor.id,
                    "band": band.name,
                    "nei_w_m2": nei_w_m2,
                    "share_in_pixel": float(receiver.plane.peak_share[place]),
                    "saturation_w_m2": float(receiver.plane.most_w_m2(0.0)[place, 0]),
                    "least_noise_over_nei": float(own[:, place].min() / nei_w_m2)
                    if len(own)
                    else None,
                    "largest_noise_over_nei": float(own[:, place].max() / nei_w_m2)
                    if len(own)
                    else None,
                }

    def shortfall_text(self, look: Exposures) -> str:
        """Return by how much a look is below its threshold: the signal is that of one band with the
        same P_d.
        """
        receiver = self.receivers[self.alike[look.sensor[0]]]
        response = self.response(look)
        assert response.probit is not None
        threshold = receiver.radiometer.threshold
        if response.snr.max() >= threshold:
            return "rejected by the sensor's rule over bands"
        signal = float(response.probit[0]) + threshold
        factor = threshold / max(signal, _FAINT)
        times = (
            f"{'at best' if signal > _FAINT else 'more than'}"
            f" {factor:.{2 if factor < 100.0 else 3}g} times"
        )
        return f"{times} below the threshold of {threshold:g} sigma"

    def _line_of_sight_error(self, number: int) -> LineOfSightError:
        return LineOfSightError(
            self.floor_rad[number], self.ifov_rad[number], self.receivers[number].plane
        )

    def _noise_w_m2(
        self, exposures: Exposures, rows_of_kind: RowsOfKind, signal_w_m2: FloatArray
    ) -> FloatArray:
        """Return the noise (B, n) at the aperture, W/m²; 1 beyond a sensor's bands.

        Signals (B, n) of sensors with a focal plane are limited, in place, to what fills a well.
        """
        noise = np.ascontiguousarray(self.dark_noise_w_m2.T).take(exposures.sensor, axis=1)
        has_background = self.environment.has_background
        view = self.environment.views(exposures) if has_background else None
        for number, rows in rows_of_kind:
            receiver = self.receivers[number]
            pixel_sr = self.ifov_rad[number] ** 2
            width = len(receiver.bands)
            behind = np.zeros((len(receiver.bands), 1))
            if view is not None:
                radiance, clutter = self._background(
                    receiver, view.take(rows), exposures.sensor_ecef_m[rows]
                )
                behind = radiance * pixel_sr
                photons = photon_noise_w_m2(behind, self.count_w_m2[number, :width, None])
                noise[:width, rows] = noise_w_m2(noise[:width, rows], photons, clutter * pixel_sr)
            if receiver.plane is not None:
                signal_w_m2[:width, rows] = np.minimum(
                    signal_w_m2[:width, rows], receiver.plane.most_w_m2(behind)
                )
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
    ifov_rad = np.array([receiver.radiometer.ifov_rad for receiver in receivers])
    one_of_kind = {receiver.kind: receiver for receiver in receivers}
    of_kind = {kind: noise_chance(receiver) for kind, receiver in one_of_kind.items()}
    chances = np.exp(np.array([of_kind[receiver.kind] for receiver in receivers]))
    floor_rad = np.array([sensor.line_of_sight_sigma_rad for sensor in context.sensors])
    confirmed, again = _confirmed(context.sensors, receivers, environment, chances)
    return SnrDetection(
        environment=environment,
        receivers=tuple(receivers),
        width=max(len(receiver.bands) for receiver in receivers),
        alike=_alike(receivers, floor_rad),
        count_w_m2=_counts_w_m2(receivers),
        floor_rad=floor_rad,
        ifov_rad=ifov_rad,
        dark_noise_w_m2=_dark_noise_w_m2(receivers),
        noise_chance=chances,
        confirmation=np.array(
            [receiver.radiometer.confirmation for receiver in receivers], dtype=np.int64
        ),
        rate_per_scan=chances * resolution_cells(half_angle, ifov_rad) * confirmed,
        false_again=again,
        probability_tolerance=None if config.exact else config.probability_tolerance,
        warnings=_blind_sensors(context.sensors, environment),
    )


def _blind_sensors(
    sensors: Sequence[Sensor], environment: RadiometricEnvironment
) -> tuple[Problem, ...]:
    """Return a warning of sensors DSP with the paper's long-wave band, whose clutter and warm
    optics hide launches.
    """
    blind = [sensor for sensor in sensors if sensor.type == "DSP" and _is_long_wave(sensor)]
    if not blind or not environment.has_background:
        return ()
    ids = [sensor.id for sensor in blind]
    first = blind[0]
    listed = ids[0] if len(ids) == 1 else f"{ids[0]} and {len(ids) - 1} more"
    words = (
        f"{listed}: this DSP is the paper's ({', '.join(band.name for band in first.bands)},"
        f" {first.scan.period_ns * 1e-9:g} s), which sees no launch before the Earth, by day or by"
        " night; that of the public record (2.7 and 4.3 um, 10 s) is preset: heritage"
    )
    return (Problem("detection", words),)


def _is_long_wave(sensor: Sensor) -> bool:
    """Return whether a sensor has a focal plane and long-wave bands alone."""
    has_plane = sensor.radiometer is not None and bool(sensor.radiometer.focal_planes)
    return has_plane and min(band.lower_um for band in sensor.bands) >= _LONG_WAVE_UM


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
    again = np.empty(len(sensors))
    for number, (sensor, receiver) in enumerate(zip(sensors, receivers, strict=True)):
        radiometer = receiver.radiometer
        chance = float(chances[number])
        needed, scans = radiometer.confirmation
        height_m = float(heights_m(sensor.orbit.position_ecef_m(np.zeros(1)))[0])
        period_s = sensor.scan.period_ns * 1e-9
        speed_m_s = radiometer.confirmation_speed_m_s
        back = np.arange(1.0, max(scans, 2))
        radius = gate_radius_cells(back, period_s, radiometer.ifov_rad, height_m, speed_m_s)
        correlation = scan_correlation(sensor, receiver, environment, period_s * back)
        again[number] = false_confirmation_probability(chance, 2, radius, correlation)
        if needed > 1:
            confirmed[number] = false_confirmation_probability(chance, needed, radius, correlation)
    return confirmed, again


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


def _parts(rows: slice | IntArray) -> list[slice | IntArray]:
    """Return rows divided into parts with columns that fit a processor's cache."""
    if isinstance(rows, slice):
        return [
            slice(rows.start + part.start, rows.start + part.stop)
            for part in blocks(rows.stop - rows.start)
        ]
    return [rows[part] for part in blocks(len(rows))]


def _rows_of(part: slice | IntArray, some: IntArray) -> IntArray:
    """Return some of the rows of a part."""
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
    """Return the number (sensors,) of the first receiver equal to each one."""
    first = dict[tuple[Any, ...], int]()
    kinds = [(*each.kind, floor) for each, floor in zip(receivers, floor_rad.tolist(), strict=True)]
    return np.array(
        [first.setdefault(kind, number) for number, kind in enumerate(kinds)], dtype=np.int32
    )
