"""Radiometry: how brightly things radiate, what the air lets through, what the Earth shines with; pure functions.

The chain is source, path, aperture: a `Signatures` gives in-band radiant intensity at the source (W/sr), a
`Transmittance` what of it leaves the atmosphere along a path, `irradiance` what arrives at an aperture (W/m²); a
`Background` gives the radiance (W m⁻² sr⁻¹) that lies under it.
"""
