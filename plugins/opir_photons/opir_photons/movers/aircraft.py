"""Aircraft: the light of tailpipes and afterburners.

A tailpipe is a flat grey body that faces backwards; the flame of an afterburner shines alike to all
sides. Skin, sunlight and the gas behind a dry engine are left out.
"""

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IndexArray
from opir_core.plugin import Signatures, SourceContext, Sources
from opir_photons.movers.configs import AircraftConfig
from opir_photons.movers.courses import flight_of, legs_of
from opir_photons.movers.trajectories import moving_sources, with_headings
from opir_photons.radiometry.emitters import Emitters, emitters_of
from opir_photons.radiometry.planck import grey_body_intensity
from opir_photons.radiometry.sources import by_band, grey_w_sr


@frozen(eq=False)
class JetSignatures(Signatures):
    """Jets (n,): intensities of tailpipes (bands, n) from behind, and of flames (bands,).

    `switches_s` (k,) are the times since ignition at which the state of afterburners may change,
    `burns` (k + 1,) that before and after each.
    """

    tailpipe_w_sr: FloatArray
    flame_w_sr: FloatArray
    switches_s: FloatArray
    burns: BoolArray

    def intensity_w_sr(
        self,
        band: int,
        target: IndexArray,
        time_since_ignition_s: FloatArray,
        altitude_m: FloatArray,
        aspect_rad: FloatArray,
    ) -> FloatArray:
        """Return radiant intensities (n,), W/sr; `aspect_rad` is from the direction of flight."""
        behind = np.maximum(-np.cos(aspect_rad), 0.0)
        leg = np.searchsorted(self.switches_s, time_since_ignition_s, side="right")
        flame = np.where(self.burns[leg], self.flame_w_sr[band], 0.0)
        return self.tailpipe_w_sr[band][target] * behind + flame

    @property
    def time_breakpoints_s(self) -> FloatArray | None:
        """Times since ignition (n, k) at which afterburners are lit or put out, s."""
        return np.tile(self.switches_s, (self.tailpipe_w_sr.shape[1], 1))


def aircraft_sources(config: AircraftConfig, context: SourceContext) -> Sources:
    """Return aircraft."""
    emitters = with_headings(emitters_of(config, context), context)
    end_s = emitters["end_s"]
    legs = legs_of(emitters, config.legs, config.pull_m_s2, end_s, context.path)
    bends_s = [leg.start_s for leg in legs[1:]]
    pulls_s = [leg.start_s + leg.pull_s() for leg in legs]
    turns_s = np.stack([*bends_s, *pulls_s], axis=1)
    signatures = jet_signatures(config, emitters, context)
    flight = flight_of(legs)
    return moving_sources(
        "aircraft", "other", emitters, context, flight, end_s, signatures, turns_s
    )


def jet_signatures(
    config: AircraftConfig, emitters: Emitters, context: SourceContext
) -> JetSignatures:
    """Return the signatures of aircraft."""
    flames = [
        grey_body_intensity(
            config.flame_temperature_k, config.flame_area_m2, 1.0, band.lower_um, band.upper_um
        )
        for band in context.bands
    ]
    burns = [leg.afterburner for leg in config.legs]
    return JetSignatures(
        tailpipe_w_sr=grey_w_sr(emitters, context),
        flame_w_sr=by_band(flames, 1)[:, 0],
        switches_s=np.cumsum([leg.for_s for leg in config.legs]),
        burns=np.array([*burns, config.afterburner]),
    )
