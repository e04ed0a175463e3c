"""The radiometric environment of a scene: signatures, atmosphere and background, for models that
compute signals.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from attrs import evolve, frozen

from opir_core import Plan, Scene
from opir_core.arrays import FloatArray, IndexArray, RowArray
from opir_core.flight import height_m
from opir_core.geometry import components, dot, length
from opir_core.host import owner_text
from opir_core.interfaces import Columns, Surroundings
from opir_core.planning import Targets, distinct_bands, scene_atmosphere
from opir_core.plugin import (
    Background,
    BackgroundContext,
    Band,
    Exposures,
    Host,
    Paths,
    Plume,
    SignatureContext,
    SignatureModel,
    Signatures,
    Sources,
    TargetClass,
    Transmittance,
    Views,
)
from opir_core.scene import DEFAULT_SIGNATURE, Choice
from opir_photons.radiometry.viewing import views
from opir_photons.reflection import ReflectedSunlight, coasting_crossings_s, shadow_times_s

#: Half the time step of a direction of flight, s.
_HALF_STEP_S = 0.05

#: Rows of columns, all of them as a slice.
_Rows = slice | RowArray


@frozen
class ReferenceTarget:
    """The reference target of `calibrate: paper`: the class profile of an ICBM, in the altitude
    layer of highest intensity, seen from the side. Source: opir-simulator paper (2026), section
    2.4.
    """

    profile: str = "ICBM_solid"
    time_s: float = 30.0
    altitude_m: float = 25_000.0
    burn_s: float = 170.0
    range_m: float = 3.6e7


REFERENCE_TARGET = ReferenceTarget()


@frozen(eq=False, repr=False)
class Ascents(Columns):
    """Heights (n, m), m, of targets (n,) at scene times (n, m), s, from ignition to burnout."""

    target: IndexArray
    time_s: FloatArray
    height_m: FloatArray
    targets: Targets

    def take(self, rows: Any) -> "Ascents":
        """Return the heights of some of the targets."""
        return Ascents(self.target[rows], self.time_s[rows], self.height_m[rows], self.targets)

    def times_s(self, levels_m: FloatArray) -> FloatArray:
        """Return the scene times (n, k) at which targets first rise through levels (n, k), m; nan
        if they never do.

        With three refinement steps between two samples of height: of a constant acceleration to
        0.1 % of a step between heights, after the first step; to 7.5 % in the first.
        """
        below = self.height_m[:, :-1, None] < levels_m[:, None, :]
        crossed = below & (self.height_m[:, 1:, None] >= levels_m[:, None, :])
        row, level = np.nonzero(crossed.any(axis=1))
        step = crossed.argmax(axis=1)[row, level]
        low_s = self.time_s[row, step]
        high_s = self.time_s[row, step + 1]
        low_m = self.height_m[row, step]
        high_m = self.height_m[row, step + 1]
        level_m = levels_m[row, level]
        for _ in range(3):
            middle_s = low_s + (high_s - low_s) * (level_m - low_m) / (high_m - low_m)
            middle_m = heights_m(self.targets.position_ecef_m(self.target[row], middle_s))
            is_low = middle_m < level_m
            low_s = np.where(is_low, middle_s, low_s)
            low_m = np.where(is_low, middle_m, low_m)
            high_s = np.where(is_low, high_s, middle_s)
            high_m = np.where(is_low, high_m, middle_m)
        times_s = np.full(levels_m.shape, np.nan)
        rise_m = np.maximum(high_m - low_m, 1e-300)
        times_s[row, level] = low_s + (high_s - low_s) * (level_m - low_m) / rise_m
        return times_s


def ascents(targets: Targets) -> Ascents:
    """Return the heights of all targets during their burns."""
    target = np.arange(len(targets.ids), dtype=np.int32)
    share = np.arange(49) / 48
    time_s = targets.ignition_s[:, None] + (targets.burnout_s - targets.ignition_s)[:, None] * share
    # Rounding must not lead out of the burn.
    time_s = np.minimum(time_s, targets.burnout_s[:, None])
    height_m = heights_m(targets.position_ecef_m(np.repeat(target, len(share)), time_s.ravel()))
    return Ascents(target, time_s, height_m.reshape(time_s.shape), targets)


def heights_m(position_ecef_m: FloatArray) -> FloatArray:
    """Return heights (n,) above the WGS 84 ellipsoid of positions (n, 3), ECEF, m, to 2e-8 m."""
    position = position_ecef_m.T
    return height_m(position, 1.0 / length(*position))


def entry_times_s(targets: Targets, level_m: float) -> FloatArray:
    """Return the scene times (targets, k) at which targets cross a height, m, after burnout; or
    nan.
    """

    def margin(target: IndexArray, time_s: FloatArray) -> FloatArray:
        return heights_m(targets.position_ecef_m(target, time_s)) - level_m

    return coasting_crossings_s(targets, [margin])


@frozen(eq=False)
class RadiometricEnvironment:
    """Signatures of all targets, the atmosphere and the background, for the distinct `bands` of the
    scene's sensors.

    Target k has row `place[k]` of `signatures[group[k]]`. `sunlight` is reflected by bodies, None
    in scenes where none is observed.
    """

    bands: tuple[Band, ...]
    targets: Targets
    signatures: tuple[Signatures, ...]
    group: IndexArray
    place: IndexArray
    atmosphere: Transmittance
    background: Background
    epoch_us: int
    has_background: bool
    reference_intensity_w_sr: FloatArray
    sunlight: ReflectedSunlight | None = None

    def paths(self, exposures: Exposures) -> Paths:
        """Return the light paths of looks."""
        return Paths(
            height_m=heights_m(exposures.target_ecef_m),
            elevation_sine=exposures.elevation_sine,
            target_ecef_m=exposures.target_ecef_m,
            sensor_ecef_m=exposures.sensor_ecef_m,
            time_s=exposures.time_s,
        )

    def views(self, exposures: Exposures) -> Views:
        """Return the background views behind the targets of looks."""
        direction = exposures.target_ecef_m - exposures.sensor_ecef_m
        return views(exposures.sensor_ecef_m, direction, exposures.time_s, self.epoch_us)

    def aspect_rad(self, exposures: Exposures) -> FloatArray:
        """Return the aspect angles (n,) of targets, rad, as defined by their signatures."""
        to_sensor = (exposures.sensor_ecef_m - exposures.target_ecef_m) / exposures.range_m[:, None]

        def angles_rad(signatures: Signatures, rows: _Rows) -> FloatArray:
            place = self.place[exposures.target[rows]]
            angle_rad = signatures.aspect_rad(
                place, exposures.emission_time_s[rows], to_sensor[rows]
            )
            if angle_rad is None:
                return self._off_flight_rad(exposures.take(rows), to_sensor[rows])
            return angle_rad

        return self._by_signatures(exposures.target, (), angles_rad)

    def intensities_w_sr(
        self, bands: Sequence[int], exposures: Exposures, height_m: FloatArray, aspect: FloatArray
    ) -> FloatArray:
        """Return the in-band radiant intensities (bands, n) of the targets of looks, at the
        source.
        """
        since_s = self._since_ignition_s(exposures)

        def emitted_w_sr(signatures: Signatures, rows: _Rows) -> FloatArray:
            place = self.place[exposures.target[rows]]
            return signatures.intensities_w_sr(
                bands, place, since_s[rows], height_m[rows], aspect[rows]
            )

        intensity = self._by_signatures(exposures.target, (len(bands),), emitted_w_sr)
        if self.sunlight is not None:
            area = self.reflecting_area_m2(exposures.target, since_s)
            bodies = np.flatnonzero(area > 0.0)
            intensity[:, bodies] += self.sunlight.intensities_w_sr(
                bands, exposures.take(bodies), height_m[bodies], area[bodies]
            )
        self._add_air_heated(intensity, bands, exposures, height_m)
        return intensity

    def _add_air_heated(
        self,
        intensity: FloatArray,
        bands: Sequence[int],
        exposures: Exposures,
        height_m: FloatArray,
    ) -> None:
        """Add to intensities (bands, n), in place, what bodies radiate more since the air heats
        them.
        """
        coasting = self._coasting(exposures)
        group = self.group[exposures.target[coasting]]
        for number, signatures in enumerate(self.signatures):
            rows = coasting[group == number]
            rows = rows[height_m[rows] < signatures.heated_below_m]
            if len(rows):
                target = exposures.target[rows]
                speed_m_s = self._speeds_m_s(target, exposures.emission_time_s[rows])
                intensity[:, rows] += signatures.air_heated_w_sr(
                    bands, self.place[target], height_m[rows], speed_m_s
                )

    def _coasting(self, exposures: Exposures) -> RowArray:
        """Return the rows of looks at targets after burnout, or in dark gaps."""
        time_s = exposures.emission_time_s
        coasts = time_s > self.targets.burnout_s[exposures.target]
        return np.flatnonzero(coasts | self.targets.is_dark(exposures.target, time_s))

    def _speeds_m_s(self, target: IndexArray, time_s: FloatArray) -> FloatArray:
        """Return the speeds (n,) of targets over the Earth, m/s."""
        way_m, step_s = self._ways(target, time_s)
        return length(*components(way_m)) / np.maximum(step_s, _HALF_STEP_S)

    def _since_ignition_s(self, exposures: Exposures) -> FloatArray:
        """Return times since ignition (n,) for signatures: in dark gaps that just after burnout, of
        a cold body.
        """
        targets = self.targets
        target = exposures.target
        since_s = exposures.emission_time_s - targets.ignition_s[target]
        dark = np.flatnonzero(targets.is_dark(target, exposures.emission_time_s))
        if len(dark):
            burn_s = targets.burnout_s[target[dark]] - targets.ignition_s[target[dark]]
            since_s[dark] = np.nextafter(burn_s, np.inf)
        return since_s

    def _by_signatures(
        self,
        target: IndexArray,
        shape: tuple[int, ...],
        values_of: Callable[[Signatures, _Rows], FloatArray],
    ) -> FloatArray:
        """Return values (*shape, n) of targets (n,), each from its signatures."""
        if len(self.signatures) == 1:
            return values_of(self.signatures[0], slice(None))
        values = np.empty((*shape, len(target)))
        group = self.group[target]
        for number, signatures in enumerate(self.signatures):
            rows = np.flatnonzero(group == number)
            values[..., rows] = values_of(signatures, rows)
        return values

    def reflecting_area_m2(self, target: IndexArray, since_s: FloatArray) -> FloatArray:
        """Return albedo times cross-section (n,) of targets at times since ignition (n,)."""

        def areas_m2(signatures: Signatures, rows: _Rows) -> FloatArray:
            return signatures.reflecting_area_m2(self.place[target[rows]], since_s[rows])

        return self._by_signatures(target, (), areas_m2)

    def breakpoints_s(self) -> FloatArray:
        """Return the scene times (targets, k) at which signals may jump or bend; nan for none.

        They come from signatures, the atmosphere, the trajectories (burns, direction of flight) and
        the Earth's shadow.
        """
        heights = ascents(self.targets)
        air = self.atmosphere.altitude_breakpoints_m
        times_s = [heights.times_s(np.broadcast_to(air, (len(self.group), len(air))))]
        if self.targets.burns_s.shape[1] > 1:
            times_s.append(self.targets.burns_s.reshape(len(self.group), -1))
        times_s += self._signature_breakpoints_s(heights)
        times_s += self._course_breakpoints_s()
        if self.sunlight is not None:
            times_s.append(shadow_times_s(self.targets, self.epoch_us))
        heated_m = max((part.heated_below_m for part in self.signatures), default=-np.inf)
        if np.isfinite(heated_m):
            times_s.append(entry_times_s(self.targets, heated_m))
        return np.concatenate(times_s, axis=1)

    def _signature_breakpoints_s(self, heights: Ascents) -> Iterator[FloatArray]:
        """Yield the scene times (targets, k) at which signatures may jump or bend."""
        for number, signatures in enumerate(self.signatures):
            rows = np.flatnonzero(self.group == number)
            place = self.place[rows]
            levels_m = signatures.altitude_breakpoints_m
            if levels_m is not None:
                yield self._of_all(rows, heights.take(rows).times_s(levels_m[place]))
            since_s = signatures.time_breakpoints_s
            if since_s is not None:
                yield self._of_all(rows, self.targets.ignition_s[rows, None] + since_s[place])

    def _course_breakpoints_s(self) -> Iterator[FloatArray]:
        """Yield the scene times (targets, k) at which directions of flight may jump or bend."""
        for number, trajectories in enumerate(self.targets.trajectories):
            course_s = trajectories.course_breakpoints_s
            if course_s is not None:
                rows = np.flatnonzero(self.targets.group == number)
                turns_s = course_s[self.targets.place[rows]]
                # The direction of flight is that over a step about each look.
                ends_s = np.concatenate([turns_s - _HALF_STEP_S, turns_s + _HALF_STEP_S], axis=1)
                yield self._of_all(rows, ends_s)

    def _of_all(self, rows: RowArray, rows_s: FloatArray) -> FloatArray:
        """Return times (targets, k) from those of some rows; nan for the others."""
        times_s = np.full((len(self.group), rows_s.shape[1]), np.nan)
        times_s[rows] = rows_s
        return times_s

    def _off_flight_rad(self, exposures: Exposures, to_sensor: FloatArray) -> FloatArray:
        """Return the angles (n,) between the direction of flight and the direction to the sensor,
        rad.
        """
        way, _ = self._ways(exposures.target, exposures.emission_time_s)
        along = dot(way, to_sensor)
        distance = length(*components(way))
        # A target at rest is seen from the side.
        return np.arccos(np.clip(along / np.where(distance > 0.0, distance, 1.0), -1.0, 1.0))

    def _ways(self, target: IndexArray, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the ways (n, 3) of targets over a step about each time, ECEF, m, and the steps
        (n,), s, which are shorter at the ends of flights.
        """
        start_s = self.targets.ignition_s[target]
        stop_s = self.targets.end_s[target]
        before_s, after_s = (
            np.clip(time_s + step_s, start_s, stop_s) for step_s in (-_HALF_STEP_S, _HALF_STEP_S)
        )
        before_m = self.targets.position_ecef_m(target, before_s)
        return self.targets.position_ecef_m(target, after_s) - before_m, after_s - before_s


def make_environment(of: Surroundings | Plan) -> RadiometricEnvironment:
    """Return the radiometric environment of a scene; raises `ModelError` if a model does not cover
    a band.
    """
    scene = of.scene
    host = of.host
    targets = of.targets
    bands = distinct_bands(of.sensors)
    atmosphere = scene_atmosphere(scene, host, bands)
    backdrop = BackgroundContext(
        bands=bands,
        path=scene.background.path,
        epoch_us=scene.epoch_us,
        make_atmosphere=lambda: atmosphere,
    )
    background = Background.adopt(
        _built(host, scene.background, backdrop), partial(owner_text, host, scene.background)
    )
    signatures, group, place = _signatures(scene, host, bands, targets, of.sources)
    environment = RadiometricEnvironment(
        bands=bands,
        targets=targets,
        signatures=signatures,
        group=group,
        place=place,
        atmosphere=atmosphere,
        background=background,
        epoch_us=scene.epoch_us,
        has_background=scene.background.name != "none",
        reference_intensity_w_sr=_reference_intensity_w_sr(host, bands),
    )
    bodies = np.flatnonzero(targets.end_s > targets.burnout_s).astype(np.int32)
    flight_s = (targets.end_s - targets.ignition_s)[bodies]
    if not np.any(environment.reflecting_area_m2(bodies, flight_s)):
        return environment
    return evolve(environment, sunlight=ReflectedSunlight.of(bands, atmosphere, scene.epoch_us))


def _built(host: Host, choice: Choice, context: object) -> Any:
    return host.component(choice.hook, choice.name, choice.path).build(choice.config, context)


def _signatures(
    scene: Scene, host: Host, bands: tuple[Band, ...], targets: Targets, sources: Sequence[Sources]
) -> tuple[tuple[Signatures, ...], IndexArray, IndexArray]:
    """Return all signatures, and of each target the number and the row of its own."""
    group = np.full(len(targets.ids), -1, dtype=np.int32)
    place = targets.place.copy()
    signatures: list[Signatures] = []
    for source in sources:
        numbers = [
            number
            for number, trajectories in enumerate(targets.trajectories)
            if trajectories is source.trajectories
        ]
        group[np.isin(targets.group, numbers)] = len(signatures)
        signatures.append(source.signatures)
    launches = np.flatnonzero(group < 0).tolist()
    rows_by_model: dict[str, list[tuple[int, Choice]]] = {}
    choices = _signature_choices(scene, host, [targets.ids[row] for row in launches])
    for row, choice in zip(launches, choices, strict=True):
        rows_by_model.setdefault(choice.name, []).append((row, choice))
    profiles = [str(truth.get("profile", "")) for truth in targets.truth()] if launches else []
    for name, launches_of_model in rows_by_model.items():
        rows = [row for row, _ in launches_of_model]
        model_choices = [choice for _, choice in launches_of_model]
        context = _signature_context(host, bands, targets, rows, profiles, model_choices)
        group[rows] = len(signatures)
        place[rows] = np.arange(len(rows))
        component = host.component(SignatureModel, name, model_choices[0].path)
        built = component.build([choice.config for choice in model_choices], context)
        signatures.append(Signatures.adopt(built, partial(owner_text, host, model_choices[0])))
    return tuple(signatures), group, place


def _signature_context(
    host: Host,
    bands: tuple[Band, ...],
    targets: Targets,
    rows: list[int],
    profiles: Sequence[str],
    choices: Sequence[Choice],
) -> SignatureContext:
    """Return the context of the launches of one signature model."""
    types = [targets.class_names[row] for row in rows]
    row_profiles = [profiles[row] for row in rows]
    return SignatureContext(
        bands=bands,
        ids=tuple(targets.ids[row] for row in rows),
        paths=tuple(choice.path for choice in choices),
        types=tuple(types),
        profiles=tuple(row_profiles),
        burn_time_s=(targets.burnout_s - targets.ignition_s)[rows],
        plumes=_plumes(host, types, row_profiles),
        burns_s=targets.burns_s[rows] - targets.ignition_s[rows][:, None, None],
    )


def _plumes(host: Host, types: Sequence[str], profiles: Sequence[str]) -> tuple[Plume, ...]:
    classes = {name: host.component(TargetClass, name) for name in set(types)}
    return tuple(
        classes[name].plume(profile) for name, profile in zip(types, profiles, strict=True)
    )


def _signature_choices(scene: Scene, host: Host, ids: Sequence[str]) -> list[Choice]:
    """Return the signature model of each launch: its own, or the default."""
    by_id = {target.id: target for target in scene.targets}
    default = None
    choices = []
    for target_id in ids:
        target = by_id[target_id]
        choice = target.signature
        if choice is None:
            path = target.model.path
            default = default or host.component(SignatureModel, DEFAULT_SIGNATURE, path).config()
            choice = Choice(SignatureModel.hook, DEFAULT_SIGNATURE, default, path)
        choices.append(choice)
    return choices


def _reference_intensity_w_sr(host: Host, bands: tuple[Band, ...]) -> FloatArray:
    """Return the in-band intensities (bands,), W/sr, of the reference ICBM, seen from the side."""
    component = host.component(SignatureModel, DEFAULT_SIGNATURE)
    context = SignatureContext(
        bands=bands,
        ids=("reference",),
        paths=("reference",),
        types=("ICBM",),
        profiles=(REFERENCE_TARGET.profile,),
        burn_time_s=np.array([REFERENCE_TARGET.burn_s]),
    )
    plume = Signatures.adopt(component.build([component.config()], context))
    target = np.zeros(1, dtype=np.int32)
    moment = (REFERENCE_TARGET.time_s, REFERENCE_TARGET.altitude_m, 0.5 * np.pi)
    columns = np.array(moment)[:, None]
    return np.array([plume.intensity_w_sr(band, target, *columns)[0] for band in range(len(bands))])
