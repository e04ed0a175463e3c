"""Spent stages: what a launch of the scene drops where its stages burn out.

They leave with the place and the velocity of the launch, fall under gravity with J2 and drag in air
that turns with the Earth, and shine with the heat of the air, a nozzle that cools, their own warmth
and sunlight (`opir_photons.radiometry.heating`). The push of the separation is left out.
"""

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IndexArray
from opir_core.errors import ModelError
from opir_core.flight import Ephemeris, density_kg_m3
from opir_core.geometry import ecef_to_geodetic
from opir_core.plugin import Band, EquilibriumGlide, SourceContext, Sources, Trajectories
from opir_core.scene import core_plumes, core_target_classes
from opir_photons.movers.configs import SpentStagesConfig
from opir_photons.movers.falls import falls, speeds_m_s
from opir_photons.movers.sunlit import SunlitSignatures, sunlit
from opir_photons.movers.trajectories import moving_sources
from opir_photons.radiometry.emitters import Emitters
from opir_photons.radiometry.heating import HeatedBodies, heated_below_m
from opir_photons.radiometry.sources import EmitterSources

#: Time before a burnout over which the velocity is taken: shorter, and the tolerance of an
#: ephemeris shows; longer, and the growth of the acceleration does.
_STEP_S = 0.5


@frozen(eq=False)
class StageSignatures(SunlitSignatures):
    """Sunlit bodies (n,) that the air heats in `bands`, with nozzles that cool from their release
    on.
    """

    bands: tuple[Band, ...]
    bodies: HeatedBodies
    fall: Ephemeris

    def intensity_w_sr(
        self,
        band: int,
        target: IndexArray,
        time_since_ignition_s: FloatArray,
        altitude_m: FloatArray,
        aspect_rad: FloatArray,
    ) -> FloatArray:
        """Return radiant intensities (n,), W/sr; `aspect_rad` is the phase angle of the Sun."""
        light = super().intensity_w_sr(band, target, time_since_ignition_s, altitude_m, aspect_rad)
        chosen = self.bands[band : band + 1]
        light = light + self.bodies.nozzle_w_sr(chosen, target, time_since_ignition_s)[0]
        rows = np.flatnonzero(altitude_m < heated_below_m())
        density = density_kg_m3(np.maximum(altitude_m[rows], 0.0))
        speed_m_s = speeds_m_s(self.fall, target[rows], time_since_ignition_s[rows])
        light[rows] += self.bodies.excess_w_sr(chosen, target[rows], density, speed_m_s)[0]
        return light


def spent_stage_sources(config: SpentStagesConfig, context: SourceContext) -> Sources:
    """Return the stages that a launch drops; `ModelError` for one that drops none."""
    if context.launched is None:
        raise ModelError(f"{context.path}: spent stages need the launches of a scene")
    trajectories, row = context.launched(config.launch)
    release_s = _releases_s(config, trajectories, row)
    release_s = release_s[release_s < context.duration_s]
    if not len(release_s):
        raise ModelError(
            f"{context.path}.launch: {config.launch!r} drops no stage within the scene; a launch in"
            " one burn keeps its stage, unless drops_last: true"
        )
    place_m, velocity_m_s = _states(trajectories, row, release_s)
    emitters = _emitters(config, place_m, release_s, context)
    # What is dropped lower is followed down to there.
    lowest_m = min(config.lowest_m, float(emitters["height_m"].min()) - 1.0)
    fall, end_s = falls(emitters, place_m, velocity_m_s, lowest_m)
    return _shining(emitters, context, fall, end_s)


def _releases_s(config: SpentStagesConfig, trajectories: Trajectories, row: int) -> FloatArray:
    """Return the scene times (k,) at which stages are dropped: the ends of burns, or equal shares
    of the only one.
    """
    ends_s = trajectories.burns_s[row, :, 1]
    ends_s = ends_s[np.isfinite(ends_s)]
    if len(ends_s) == 1:
        begin_s = trajectories.ignition_s[row]
        plume = core_plumes().get(str(trajectories.truth()[row].get("profile", "")))
        count = config.stages or (plume.stages if plume else 1)
        ends_s = begin_s + (ends_s - begin_s) * np.arange(1, count + 1) / count
    return ends_s if _drops_last(config, trajectories.class_names[row]) else ends_s[:-1]


def _drops_last(config: SpentStagesConfig, class_name: str) -> bool:
    """Whether the last stage is dropped, too: gliders leave it."""
    if config.drops_last is not None:
        return config.drops_last
    kind = core_target_classes().get(class_name)
    return kind is not None and isinstance(kind.after_burnout, EquilibriumGlide)


def _states(
    trajectories: Trajectories, row: int, time_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return places and velocities (k, 3) of a launch at times (k,), by what came before them: a
    flight may end there.
    """
    rows = np.full(len(time_s), row, dtype=np.int32)
    place, before, earlier = (
        trajectories.position_ecef_m(rows, time_s - step * _STEP_S) for step in (0.0, 1.0, 2.0)
    )
    return place, (3.0 * place - 4.0 * before + earlier) / (2.0 * _STEP_S)


def _emitters(
    config: SpentStagesConfig, place_m: FloatArray, release_s: FloatArray, context: SourceContext
) -> Emitters:
    """Return stages at their places, with the settings of their block."""
    place = ecef_to_geodetic(place_m)
    columns = {
        "lat_deg": np.degrees(place.latitude_rad),
        "lon_deg": np.degrees(place.longitude_rad),
        "height_m": place.height_m,
        "start_s": release_s,
        "end_s": np.full(len(release_s), context.duration_s + 10.0),
    }
    names = ("temperature_k", "emissivity", "area_m2", "albedo", "ballistic_coefficient_kg_m2")
    for name in names:
        columns[name] = np.full(len(release_s), getattr(config, name))
    return Emitters(columns)


def _shining(
    emitters: Emitters, context: SourceContext, fall: Ephemeris, end_s: FloatArray
) -> EmitterSources:
    """Return stages on their falls with their light."""
    kind = "spent stage"
    signatures = StageSignatures(
        **sunlit(emitters, context, fall),
        bands=context.bands,
        bodies=HeatedBodies.of(
            [kind] * len(emitters),
            emitters["area_m2"],
            emitters["emissivity"],
            emitters["temperature_k"],
        ),
        fall=fall,
    )
    sources = moving_sources(kind, "other", emitters, context, fall, end_s, signatures)
    return EmitterSources(tuple(sources.ids), sources.trajectories, signatures)
