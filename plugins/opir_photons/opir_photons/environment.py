"""The radiometric environment of a scene: signatures, atmosphere and background, for models that
compute signals.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from attrs import evolve, frozen

from opir_core import Plan, Scene
from opir_core.arrays import FloatArray, IndexArray, RowArray
from opir_core.flight import height_m
from opir_core.geometry import length
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
from opir_photons.reflection import ReflectedSunlight, shadow_times_s

#: Half the time step of a direction of flight, s.
_HALF_STEP_S = 0.05

#: The reference target of `calibrate: paper`: the class profile of an ICBM, in the altitude layer
#: of highest intensity.
REFERENCE_PROFILE = "ICBM_solid"
REFERENCE_TIME_S = 30.0
REFERENCE_ALTITUDE_M = 25_000.0
REFERENCE_BURN_S = 170.0


#: Samples of height during a burn, and refinement steps of an altitude crossing between two of
#: them.
_SAMPLES = 48
_STEPS = 3


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

        Of a constant acceleration to 0.1 % of a step between heights, after the first step; to 7.5
        % in the first.
        """
        below = self.height_m[:, :-1, None] < levels_m[:, None, :]
        crossed = below & (self.height_m[:, 1:, None] >= levels_m[:, None, :])
        row, level = np.nonzero(crossed.any(axis=1))
        step = crossed.argmax(axis=1)[row, level]
        low_s = self.time_s[row, step]
        high_s = self.time_s[row, step + 1]
        low_m = self.height_m[row, step]
        high_m = self.height_m[row, step + 1]
        wanted_m = levels_m[row, level]
        for _ in range(_STEPS):
            middle_s = low_s + (high_s - low_s) * (wanted_m - low_m) / (high_m - low_m)
            middle_m = heights_m(self.targets.position_ecef_m(self.target[row], middle_s))
            is_low = middle_m < wanted_m
            low_s = np.where(is_low, middle_s, low_s)
            low_m = np.where(is_low, middle_m, low_m)
            high_s = np.where(is_low, high_s, middle_s)
            high_m = np.where(is_low, high_m, middle_m)
        times_s = np.full(levels_m.shape, np.nan)
        times_s[row, level] = low_s + (high_s - low_s) * (wanted_m - low_m) / np.maximum(
            high_m - low_m, 1e-300
        )
        return times_s


def ascents(targets: Targets) -> Ascents:
    """Return the heights of all targets during their burns."""
    everyone = np.arange(len(targets.ids), dtype=np.int32)
    share = np.arange(_SAMPLES + 1) / _SAMPLES
    time_s = targets.ignition_s[:, None] + (targets.burnout_s - targets.ignition_s)[:, None] * share
    # Rounding must not lead out of the burn.
    time_s = np.minimum(time_s, targets.burnout_s[:, None])
    height_m = heights_m(targets.position_ecef_m(np.repeat(everyone, _SAMPLES + 1), time_s.ravel()))
    return Ascents(everyone, time_s, height_m.reshape(time_s.shape), targets)


def heights_m(position_ecef_m: FloatArray) -> FloatArray:
    """Return heights (n,) above the WGS 84 ellipsoid of positions (n, 3), ECEF, m, to 2e-8 m."""
    position = position_ecef_m.T
    return height_m(position, 1.0 / length(*position))


@frozen(eq=False)
class RadiometricEnvironment:
    """Signatures of all targets, the atmosphere and the background, for the distinct `bands` of the
    scene's sensors.

    Target k has row `place[k]` of `signatures[group[k]]`. `sunlight` is what bodies reflect, None
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
        if len(self.signatures) == 1:
            alone = self.signatures[0].aspect_rad(
                self.place[exposures.target], exposures.emission_time_s, to_sensor
            )
            return self._off_flight_rad(exposures, to_sensor) if alone is None else alone
        aspect = np.empty(len(exposures))
        for number, signatures in enumerate(self.signatures):
            rows = np.flatnonzero(self.group[exposures.target] == number)
            place = self.place[exposures.target[rows]]
            own = signatures.aspect_rad(place, exposures.emission_time_s[rows], to_sensor[rows])
            aspect[rows] = (
                self._off_flight_rad(exposures.take(rows), to_sensor[rows]) if own is None else own
            )
        return aspect

    def intensities_w_sr(
        self, bands: Sequence[int], exposures: Exposures, height_m: FloatArray, aspect: FloatArray
    ) -> FloatArray:
        """Return the in-band radiant intensities (bands, n) of the targets of looks, at the
        source.
        """
        since_s = self._since_ignition_s(exposures)
        intensity = self._own_intensities_w_sr(bands, exposures.target, since_s, height_m, aspect)
        if self.sunlight is not None:
            area = self.reflecting_area_m2(exposures.target, since_s)
            late = np.flatnonzero(area > 0.0)
            looks = exposures.take(late)
            intensity[:, late] += self.sunlight.intensities_w_sr(
                bands, looks, height_m[late], area[late]
            )
        return intensity

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

    def _own_intensities_w_sr(
        self,
        bands: Sequence[int],
        target: IndexArray,
        since_s: FloatArray,
        height_m: FloatArray,
        aspect: FloatArray,
    ) -> FloatArray:
        """Return what signatures radiate (bands, n)."""
        place = self.place[target]
        group = self.group[target]
        if len(self.signatures) == 1:
            return self.signatures[0].intensities_w_sr(bands, place, since_s, height_m, aspect)
        intensity = np.empty((len(bands), len(target)))
        for number, signatures in enumerate(self.signatures):
            rows = np.flatnonzero(group == number)
            own = signatures.intensities_w_sr(
                bands, place[rows], since_s[rows], height_m[rows], aspect[rows]
            )
            intensity[:, rows] = own
        return intensity

    def reflecting_area_m2(self, target: IndexArray, since_s: FloatArray) -> FloatArray:
        """Return albedo times cross-section (n,) of targets at times since ignition (n,)."""
        area = np.zeros(len(target))
        group = self.group[target]
        for number, signatures in enumerate(self.signatures):
            rows = np.flatnonzero(group == number)
            area[rows] = signatures.reflecting_area_m2(self.place[target[rows]], since_s[rows])
        return area

    def breakpoints_s(self) -> FloatArray:
        """Return the scene times (targets, k) at which signals may jump or bend; nan for none.

        They come from signatures, the atmosphere, the trajectories (burns, direction of flight) and
        the Earth's shadow.
        """
        everyone = [np.flatnonzero(self.group == number) for number in range(len(self.signatures))]
        heights = ascents(self.targets)
        air = self.atmosphere.altitude_breakpoints_m
        times_s = [heights.times_s(np.broadcast_to(air, (len(self.group), len(air))))]
        if self.targets.burns_s.shape[1] > 1:
            times_s.append(self.targets.burns_s.reshape(len(self.group), -1))
        for signatures, rows in zip(self.signatures, everyone, strict=True):
            levels_m = signatures.altitude_breakpoints_m
            since_s = signatures.time_breakpoints_s
            if levels_m is not None:
                times_s.append(
                    self._of_all(rows, heights.take(rows).times_s(levels_m[self.place[rows]]))
                )
            if since_s is not None:
                times_s.append(
                    self._of_all(
                        rows, self.targets.ignition_s[rows, None] + since_s[self.place[rows]]
                    )
                )
        for number, trajectories in enumerate(self.targets.trajectories):
            own_s = trajectories.course_breakpoints_s
            if own_s is not None:
                turning = np.flatnonzero(self.targets.group == number)
                turns_s = own_s[self.targets.place[turning]]
                # The direction of flight is that over a step about each look.
                ends_s = np.concatenate([turns_s - _HALF_STEP_S, turns_s + _HALF_STEP_S], axis=1)
                times_s.append(self._of_all(turning, ends_s))
        if self.sunlight is not None:
            times_s.append(shadow_times_s(self.targets, self.epoch_us))
        return np.concatenate(times_s, axis=1)

    def _of_all(self, rows: RowArray, own_s: FloatArray) -> FloatArray:
        """Return times (targets, k) from those of some rows; nan for the others."""
        times_s = np.full((len(self.group), own_s.shape[1]), np.nan)
        times_s[rows] = own_s
        return times_s

    def _off_flight_rad(self, exposures: Exposures, to_sensor: FloatArray) -> FloatArray:
        """Return the angles (n,) between the direction of flight and the direction to the sensor,
        rad.
        """
        target = exposures.target
        time_s = exposures.emission_time_s
        start_s = self.targets.ignition_s[target]
        stop_s = self.targets.end_s[target]
        later = self.targets.position_ecef_m(
            target, np.clip(time_s + _HALF_STEP_S, start_s, stop_s)
        )
        way = later - self.targets.position_ecef_m(
            target, np.clip(time_s - _HALF_STEP_S, start_s, stop_s)
        )
        along = (
            way[:, 0] * to_sensor[:, 0] + way[:, 1] * to_sensor[:, 1] + way[:, 2] * to_sensor[:, 2]
        )
        distance = np.sqrt(way[:, 0] * way[:, 0] + way[:, 1] * way[:, 1] + way[:, 2] * way[:, 2])
        # A target at rest is seen from the side.
        return np.arccos(np.clip(along / np.where(distance > 0.0, distance, 1.0), -1.0, 1.0))


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
    signatures, group, place = _signatures(scene, host, bands, targets, of.sources)
    environment = RadiometricEnvironment(
        bands=bands,
        targets=targets,
        signatures=signatures,
        group=group,
        place=place,
        atmosphere=atmosphere,
        background=Background.adopt(
            _built(host, scene.background, backdrop), partial(owner_text, host, scene.background)
        ),
        epoch_us=scene.epoch_us,
        has_background=scene.background.name != "none",
        reference_intensity_w_sr=_reference_intensity_w_sr(host, bands),
    )
    followed = np.flatnonzero(targets.end_s > targets.burnout_s).astype(np.int32)
    if not np.any(
        environment.reflecting_area_m2(followed, (targets.end_s - targets.ignition_s)[followed])
    ):
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
    made: list[Signatures] = []
    for source in sources:
        numbers = [
            number
            for number, known in enumerate(targets.trajectories)
            if known is source.trajectories
        ]
        group[np.isin(targets.group, numbers)] = len(made)
        made.append(source.signatures)
    launches = np.flatnonzero(group < 0).tolist()
    choices = _signature_choices(scene, host, [targets.ids[row] for row in launches])
    profiles = [str(truth.get("profile", "")) for truth in targets.truth()] if launches else []
    classes = {
        name: host.component(TargetClass, name)
        for name in {targets.class_names[row] for row in launches}
    }
    for name in dict.fromkeys(choice.name for choice in choices):
        rows = [row for row, choice in zip(launches, choices, strict=True) if choice.name == name]
        chosen = [choice for choice in choices if choice.name == name]
        context = SignatureContext(
            bands=bands,
            ids=tuple(targets.ids[row] for row in rows),
            paths=tuple(choice.path for choice in chosen),
            types=tuple(targets.class_names[row] for row in rows),
            profiles=tuple(profiles[row] for row in rows),
            burn_time_s=(targets.burnout_s - targets.ignition_s)[rows],
            plumes=tuple(classes[targets.class_names[row]].plume(profiles[row]) for row in rows),
            burns_s=targets.burns_s[rows] - targets.ignition_s[rows][:, None, None],
        )
        group[rows] = len(made)
        place[rows] = np.arange(len(rows))
        component = host.component(SignatureModel, name, chosen[0].path)
        built = component.build([choice.config for choice in chosen], context)
        made.append(Signatures.adopt(built, partial(owner_text, host, chosen[0])))
    return tuple(made), group, place


def _signature_choices(scene: Scene, host: Host, ids: Sequence[str]) -> list[Choice]:
    """Return the signature model of each launch: its own, or the default."""
    of_id = {target.id: target for target in scene.targets}
    default = None
    choices = []
    for own_id in ids:
        target = of_id[own_id]
        if target.signature is None:
            default = (
                default
                or host.component(SignatureModel, DEFAULT_SIGNATURE, target.model.path).config()
            )
        choices.append(
            target.signature
            or Choice(SignatureModel.hook, DEFAULT_SIGNATURE, default, target.model.path)
        )
    return choices


def _reference_intensity_w_sr(host: Host, bands: tuple[Band, ...]) -> FloatArray:
    """Return the in-band intensities (bands,), W/sr, of the reference ICBM, seen from the side."""
    component = host.component(SignatureModel, DEFAULT_SIGNATURE)
    context = SignatureContext(
        bands=bands,
        ids=("reference",),
        paths=("reference",),
        types=("ICBM",),
        profiles=(REFERENCE_PROFILE,),
        burn_time_s=np.array([REFERENCE_BURN_S]),
    )
    plume = Signatures.adopt(component.build([component.config()], context))
    one = np.zeros(1, dtype=np.int32)
    place = (REFERENCE_TIME_S, REFERENCE_ALTITUDE_M, 0.5 * np.pi)
    columns = [np.array([value]) for value in place]
    return np.array([plume.intensity_w_sr(band, one, *columns)[0] for band in range(len(bands))])
