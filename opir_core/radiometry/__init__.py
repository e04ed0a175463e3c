"""Radiometry: radiance of black bodies, transmittance of the atmosphere, background radiance, irradiance at a sensor.

The chain is source, path, aperture: a `Signatures` model gives in-band radiant intensity at the source (W/sr), a
`Transmittance` the share of it that leaves the atmosphere along a path, `irradiance_at_aperture` the irradiance at the
sensor (W/m²); a `Background` gives the radiance behind the target (W m⁻² sr⁻¹). These protocols are in
`opir_core.plugin`. Each name is imported when it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from opir_core.interfaces.radiometric_models import Paths, Views
    from opir_core.radiometry.aperture import (
        irradiance_at_aperture,
        irradiance_of_projected_area,
        irradiance_of_sphere,
        minimum_detectable_intensity,
    )
    from opir_core.radiometry.lowtran import band_transmittance
    from opir_core.radiometry.planck import (
        Temperature,
        band_photon_radiance,
        band_radiance,
        band_radiance_slope,
        band_ratio,
        grey_body_intensity,
        planck_photon_radiance,
        planck_radiance,
        two_colour_temperature,
    )

#: The module of each name, by which it is imported when it is first used.
_HOMES = {
    "radiometry.aperture": (
        "irradiance_at_aperture irradiance_of_projected_area irradiance_of_sphere minimum_detectable_intensity"
    ),
    "radiometry.lowtran": "band_transmittance",
    "radiometry.planck": (
        "Temperature band_photon_radiance band_radiance band_radiance_slope band_ratio grey_body_intensity "
        "planck_photon_radiance planck_radiance two_colour_temperature"
    ),
    "interfaces.radiometric_models": "Paths Views",
}

__all__ = [
    "Paths",
    "Temperature",
    "Views",
    "band_photon_radiance",
    "band_radiance",
    "band_radiance_slope",
    "band_ratio",
    "band_transmittance",
    "grey_body_intensity",
    "irradiance_at_aperture",
    "irradiance_of_projected_area",
    "irradiance_of_sphere",
    "minimum_detectable_intensity",
    "planck_photon_radiance",
    "planck_radiance",
    "two_colour_temperature",
]


def __getattr__(name: str) -> Any:
    for home, names in _HOMES.items():
        if name in names.split():
            value = globals()[name] = getattr(import_module(f"opir_core.{home}"), name)
            return value
    raise AttributeError(f"module 'opir_core.radiometry' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
