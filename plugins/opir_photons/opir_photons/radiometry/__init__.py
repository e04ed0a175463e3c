"""Radiometry: radiance of black bodies, transmittance of the atmosphere, background radiance,
irradiance at a sensor.

The chain is source, path, aperture: a `Signatures` model gives in-band radiant intensity at the
source (W/sr), a `Transmittance` the share of it that leaves the atmosphere along a path,
`irradiance_at_aperture` the irradiance at the sensor (W/m²); a `Background` gives the radiance
behind the target (W m⁻² sr⁻¹). These protocols are in `opir_core.plugin`. For the focal plane:
spots, pixels, electrons, noise, centroids, and the clutter that filters leave. Each name is
imported when it is first used.
"""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
