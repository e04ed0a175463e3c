"""Plumes, the atmosphere, the background and sources; each is built by a module that its use
imports.
"""

from collections.abc import Iterable, Sequence

from opir_core.plugin import (
    AtmosphereModel,
    BackgroundModel,
    SignatureModel,
    SourceModel,
    deferred,
    hookimpl,
)
from opir_photons.radiometry.configs import EarthConfig, LowtranConfig, PlumeConfig
from opir_photons.radiometry.source_configs import (
    BolideConfig,
    FireConfig,
    FlareConfig,
    GlintConfig,
)


@hookimpl
def opir_signature_models() -> Iterable[SignatureModel]:
    """Yield `plume`."""
    yield SignatureModel(
        name="plume",
        summary="notional plume by class, thrust phase, altitude and aspect, with a spectrum for"
        " any band",
        config=PlumeConfig,
        build=deferred("opir_photons.radiometry.plume.plume_signatures"),
    )


def _skies(config: LowtranConfig) -> Sequence[str]:
    """Return what an atmosphere lets a background show: the sky below it, its opaque cloud."""
    cover = 0.0 if config.cloud is None else config.cloud.cover
    return (["sky"] if cover < 1.0 else []) + (["cloud", "any cloud"] if cover > 0.0 else [])


@hookimpl
def opir_atmosphere_models() -> Iterable[AtmosphereModel]:
    """Yield `lowtran`."""
    yield AtmosphereModel(
        name="lowtran",
        summary="band transmittances of LOWTRAN7 for six climates, with a deck of cloud where one"
        " is set",
        config=LowtranConfig,
        build=deferred("opir_photons.radiometry.lowtran.lowtran_atmosphere"),
        reads=_skies,
    )


def _clouds(config: EarthConfig) -> Sequence[str]:
    return [] if config.sky == "clear" else ["any cloud"]


@hookimpl
def opir_background_models() -> Iterable[BackgroundModel]:
    """Yield `earth`."""
    yield BackgroundModel(
        name="earth",
        summary="radiance of the Earth by sun, sky, cloud and look angle from LOWTRAN7, and the"
        " clutter it leaves",
        config=EarthConfig,
        build=deferred("opir_photons.radiometry.earth.earth_background"),
        reads=_clouds,
    )


@hookimpl
def opir_source_models() -> Iterable[SourceModel]:
    """Yield `fires`, `flares`, `glints` and `bolides`."""
    yield SourceModel(
        name="fires",
        summary="flat grey bodies on the ground",
        config=FireConfig,
        build=deferred("opir_photons.radiometry.sources.fire_sources"),
    )
    yield SourceModel(
        name="flares",
        summary="gas flares: grey bodies that shine alike to all sides",
        config=FlareConfig,
        build=deferred("opir_photons.radiometry.sources.flare_sources"),
    )
    yield SourceModel(
        name="glints",
        summary="water that mirrors the Sun, by the slopes that wind gives it",
        config=GlintConfig,
        build=deferred("opir_photons.radiometry.sources.glint_sources"),
    )
    yield SourceModel(
        name="bolides",
        summary="meteors that flash on a straight way down",
        config=BolideConfig,
        build=deferred("opir_photons.radiometry.sources.bolide_sources"),
    )
