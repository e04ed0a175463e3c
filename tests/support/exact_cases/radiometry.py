"""References of radiometry: Planck's law by its series, apertures, focal planes, clutter, and
tables read exactly.
"""

from functools import cache

import mpmath as mp
import numpy as np
import opir_photons.radiometry as radiometry
from opir_photons.laws import law
from opir_photons.radiometry import lowtran
from opir_photons.radiometry.long_paths import (
    BEND,
    CLIMBS,
    HIGHEST_ROOT,
    HIGHEST_SLANT,
    RADIUS_M,
    TOP_M,
)

from exact_cases import draws
from exact_cases.measure import Case, bound_of
from opir_core.constants import SPEED_OF_LIGHT_M_S
from opir_core.geometry.sun import ASTRONOMICAL_UNIT_M, SUN_RADIUS_M
from opir_core.plugin import Band

with mp.workdps(60):
    H = mp.mpf("6.62607015e-34")
    K = mp.mpf("1.380649e-23")
    C = mp.mpf(SPEED_OF_LIGHT_M_S)
HEATED = law("heated_bodies")
SHORT = Band("short", 2.0, 2.5)
MID = Band("mid", 3.0, 5.0)
LONG = Band("long", 8.0, 12.0)


def first_radiation():
    return 2 * H * C**2 * 10**24


def first_photon():
    return 2 * C * 10**18


def second_radiation():
    return H * C / K * 10**6


def planck(temperature, wavelength, power=5):
    if temperature == 0:
        return mp.mpf(0)
    series = first_radiation() if power == 5 else first_photon()
    return series / (wavelength**power * mp.expm1(second_radiation() / (wavelength * temperature)))


def tail(x, power):
    """Return the integral of tᵖ / (eᵗ - 1) from x to infinity: near 0 by Bernoulli's series, else
    by that of e⁻ⁿˣ.
    """
    if x == 0:
        return mp.gamma(power + 1) * mp.zeta(power + 1)
    if x < mp.mpf("1.5"):
        terms = (
            mp.bernoulli(n) * x ** (n + power) / (mp.factorial(n) * (n + power))
            for n in (0, 1, *range(2, 100, 2))
        )
        return mp.gamma(power + 1) * mp.zeta(power + 1) - mp.fsum(terms)
    total = mp.mpf(0)
    n = 1
    while True:
        coefficients = [
            mp.ff(power, k) / mp.mpf(n) ** (k + 1) * x ** (power - k) for k in range(power + 1)
        ]
        term = mp.exp(-n * x) * mp.fsum(coefficients)
        total += term
        if term < total * mp.mpf(10) ** -(mp.mp.dps + 2):
            return total
        n += 1


def band(temperature, lower, upper, power=3):
    """Return the in-band radiance by the difference of two tails, with digits to spare for what
    cancels.
    """
    if temperature == 0:
        return mp.mpf(0)
    narrow = abs(upper - lower) / upper if upper else mp.mpf(1)
    with mp.workdps(mp.mp.dps + 6 + (int(-mp.log10(narrow)) if 0 < narrow < 1 else 0)):
        x, y = (second_radiation() / (edge * temperature) for edge in (upper, lower))
        series = first_radiation() if power == 3 else first_photon()
        return (
            series
            / second_radiation() ** (power + 1)
            * temperature ** (power + 1)
            * (tail(x, power) - tail(y, power))
        )


def slope(temperature, lower, upper):
    """Return d/dT of the in-band radiance: from ∫ x⁴ eˣ/(eˣ-1)² dx by parts."""
    x, y = (second_radiation() / (edge * temperature) for edge in (upper, lower))
    with mp.workdps(mp.mp.dps + 10):
        inner = 4 * (tail(x, 3) - tail(y, 3)) + x**4 / mp.expm1(x) - y**4 / mp.expm1(y)
        return first_radiation() / second_radiation() ** 4 * temperature**3 * inner


def ratio(temperature, shorter=SHORT, longer=MID):
    return band(temperature, *edges(shorter)) / band(temperature, *edges(longer))


def edges(band):
    return mp.mpf(band.lower_um), mp.mpf(band.upper_um)


def two_colour(first, second):
    """Return the temperature of a ratio of signals, by secant steps in 1/T from the float64
    answer.
    """
    expected = mp.log(first) - mp.log(second)
    guess = radiometry.two_colour_temperature(
        [float(first)], [float(second)], [0.0], [0.0], SHORT, MID
    ).temperature_k[0]
    if np.isnan(guess):
        return None
    previous = 1 / mp.mpf(float(guess))
    current = previous * (1 + mp.mpf(10) ** -10)
    miss_before = mp.log(ratio(1 / previous)) - expected
    for _ in range(3):
        miss = mp.log(ratio(1 / current)) - expected
        step = miss * (current - previous) / (miss - miss_before)
        previous = current
        miss_before = miss
        current -= step
    return 1 / current


def bands(rng, n):
    """Return temperatures and bands: of plumes and of the Earth, wide and as narrow as doubles
    allow.
    """
    temperature = draws.log_uniform(rng, n, 80.0, 6000.0, (0.0, 20000.0, 3.0))
    lower = draws.log_uniform(rng, n, 0.4, 25.0)
    return temperature, lower, lower * (1.0 + draws.log_uniform(rng, n, 1e-12, 2.0))


def warm_bands(rng, n):
    """The same without 0 K, and wider: the reference of the slope cancels."""
    temperature, lower, _ = bands(rng, n)
    return np.maximum(temperature, 3.0), lower, lower * (1.0 + draws.log_uniform(rng, n, 1e-4, 2.0))


def phase(angle):
    with mp.workdps(mp.mp.dps + 40):
        return (mp.sin(angle) + (mp.pi - angle) * mp.cos(angle)) / mp.pi


def phases(rng, n):
    beside = np.pi - draws.log_uniform(rng, n, 1e-12, 1e-1)
    return np.where(
        rng.random(n) < 0.3, beside, draws.uniform(rng, n, 0.0, np.pi, (0.0, np.pi, 1e-300))
    )


def ensquared(kind):
    """Return the reference of a kind of ensquared energy: integrals of the spot over the square."""

    def share(sigma, pixel, count):
        with mp.workdps(mp.mp.dps + 50):
            scale = mp.sqrt(2) * sigma
            inner = (count - 1) * pixel / 2
            outer = (count + 1) * pixel / 2
            if kind == "best":
                return mp.erf(count * pixel / 2 / scale) ** 2
            if kind == "worst":
                return ((mp.erf(inner / scale) + mp.erf(outer / scale)) / 2) ** 2

            def edge(at):
                return at * mp.erf(at / scale) + scale * mp.exp(-((at / scale) ** 2)) / mp.sqrt(
                    mp.pi
                )

            return ((edge(outer) - edge(inner)) / pixel) ** 2

    return share


def spots(rng, n):
    return (
        draws.log_uniform(rng, n, 1e-9, 1e-2),
        draws.log_uniform(rng, n, 1e-6, 1e-3),
        rng.integers(1, 12, n).astype(np.float64),
    )


def usual_spots(rng, n):
    pixel = draws.log_uniform(rng, n, 1e-6, 1e-3)
    return pixel * draws.log_uniform(rng, n, 0.15, 20.0), pixel


def mean_share(width, sigma, pixel):
    """Return the mean shares of the pixels of a square, row by row, as one vector."""
    with mp.workdps(mp.mp.dps + 50):
        spread = sigma / pixel

        def edge(at):
            return at * mp.erf(at / (mp.sqrt(2) * spread)) / 2 + spread * mp.exp(
                -(at**2) / (2 * spread**2)
            ) / mp.sqrt(2 * mp.pi)

        places = [mp.mpf(k) - mp.mpf(width - 1) / 2 for k in range(width)]
        along = [edge(at + 1) - 2 * edge(at) + edge(at - 1) for at in places]
        return [a * b for a in along for b in along]


@cache
def _phases():
    return [(mp.mpf(k) + mp.mpf(1) / 2) / 64 for k in range(32)]


def centroid_factor(sigma, pixel):
    """Return the bound of a centroid without photon noise, by sums over pixels for every sub-pixel
    phase.
    """
    width = sigma / pixel
    narrow = min(width, mp.mpf(4))
    reach = int(mp.ceil(9 * max(narrow, 1))) + 2
    along = mp.mpf(0)
    across = along
    for place in _phases():
        slopes = mp.mpf(0)
        shares = slopes
        for k in range(-reach, reach + 1):
            high = (place - k + mp.mpf(1) / 2) / narrow
            low = (place - k - mp.mpf(1) / 2) / narrow
            shares += (mp.ncdf(high) - mp.ncdf(low)) ** 2
            slopes += ((mp.npdf(high) - mp.npdf(low)) / narrow) ** 2
        along = along + 1 / slopes
        across = across + 1 / shares
    return mp.sqrt(along / 32 * across / 32) * max(width / 4, mp.mpf(1)) ** 2 * pixel


def matern(distance, scale, exponent):
    order = exponent / 2 - 1
    scaled = distance / scale
    if scaled == 0:
        return mp.mpf(1)
    return 2 ** (1 - order) / mp.gamma(order) * scaled**order * mp.besselk(order, scaled)


def joined(white, photons):
    total = white + photons
    return total + photons * mp.sqrt(white / (2 * total)) if total else mp.mpf(0)


@cache
def _grid():
    """Return the fine grid of a climate that `band_transmittance` interpolates in."""
    return lowtran._cached_grid(2.0, 2.4, "us1976", "rural23km", "flat")


def _clamped(value, low, high):
    return min(max(value, mp.mpf(low)), mp.mpf(high))


def _lowest(height, sine):
    """Return the lowest height of a slant that goes down, m."""
    radius = mp.mpf(RADIUS_M)
    return height - (radius + height) * (1 - mp.sqrt(1 - sine * sine))


def transmittance(height, elevation):
    """Return the interpolation in the fine grid, exactly: linear along slants, cubic with chords'
    slopes in height.
    """
    if height >= TOP_M:
        return mp.mpf(1)
    grid = _grid()
    sine = mp.sin(elevation)
    if sine < 0:
        lowest = _lowest(height, sine)
        if lowest < 0:
            return mp.mpf(0)
        across = mp.sqrt(max(height - lowest, mp.mpf(0))) * (CLIMBS - 1) / mp.mpf(HIGHEST_ROOT)
        return _interpolated(grid.below, across, lowest)
    across = mp.asinh(sine / mp.mpf(BEND)) * (len(grid.above) - 1) / mp.mpf(HIGHEST_SLANT)
    return _interpolated(grid.above, across, height)


def _interpolated(table, across, height):
    """Return the value of a table, `across` rows from its first, at a height."""
    rows, heights = table.shape
    across = _clamped(across, 0, rows - 1)
    up = _clamped(height * (heights - 1) / mp.mpf(TOP_M), 0, heights - 1)
    row = min(int(across), rows - 2)
    column = min(int(up), heights - 2)
    fraction = across - row
    rise = up - column

    def at(r, c):
        if c < 0:
            return 2 * at(r, 0) - at(r, 1)
        if c >= heights:
            return 2 * at(r, heights - 1) - at(r, heights - 2)
        return mp.mpf(float(table[r, c]))

    lower, position, beyond, upper = (
        at(row, column + k) * (1 - fraction) + at(row + 1, column + k) * fraction
        for k in (-1, 0, 1, 2)
    )
    start_slope = (beyond - lower) / 2
    end_slope = (upper - position) / 2
    cubic = 2 * (position - beyond) + start_slope + end_slope
    bend = beyond - position - start_slope - cubic + rise * cubic
    return _clamped(position + rise * (start_slope + rise * bend), 0, 1)


def _products(name, *exponents, factor=lambda: 1):
    """Return the case of a product of powers."""

    def exact(*values):
        return factor() * mp.fprod(
            value**power for value, power in zip(values, exponents, strict=True)
        )

    def draw(rng, n):
        return [draws.log_uniform(rng, n, 1e-12, 1e12) for _ in exponents]

    return Case(f"radiometry.{name}", draw, getattr(radiometry, name), exact)


def _airflows(rng, count):
    """Return densities, speeds and nose radii."""
    bounds = ((1e-12, 1.0), (10.0, 1e4), (1e-3, 10.0))
    return [draws.log_uniform(rng, count, low, high) for low, high in bounds]


def equilibrium(flux, speed, emissivity, unheated):
    """Return the temperature T of ε σ (T⁴ - T₀⁴) = q (1 - c T / H)."""
    heat = mp.mpf(HEATED["specific_heat_j_kg_k"])
    enthalpy = heat * mp.mpf(HEATED["air_k"]) + speed**2 / 2
    stefan = 2 * mp.pi**5 * K**4 / (15 * H**3 * C**2)
    radiated = flux / (emissivity * stefan)

    def excess(kelvin):
        radiating = kelvin**4 - unheated**4 - radiated * (1 - heat * kelvin / enthalpy)
        return radiating / (unheated**4 + radiated)

    limit = mp.mpf(HEATED["limit_k"])
    if excess(limit) <= 0:
        return limit
    return max(mp.findroot(excess, (unheated / 2, limit), solver="anderson"), unheated)


def _positive(count, low=1e-6, high=1e6, special=()):
    return lambda rng, n: [draws.log_uniform(rng, n, low, high, special) for _ in range(count)]


CASES = (
    Case(
        "radiometry.planck_radiance",
        lambda r, n: bands(r, n)[:2],
        radiometry.planck_radiance,
        planck,
    ),
    Case("radiometry.band_radiance", bands, radiometry.band_radiance, band, share=0.3),
    Case(
        "radiometry.band_photon_radiance",
        bands,
        radiometry.band_photon_radiance,
        lambda *row: band(*row, power=2),
        share=0.3,
    ),
    Case(
        "radiometry.band_radiance_slope",
        warm_bands,
        radiometry.band_radiance_slope,
        slope,
        scale=(1e-280,),
        share=0.3,
    ),
    Case(
        "radiometry.grey_body_intensity",
        lambda r, n: (
            r.uniform(200.0, 3000.0, n),
            r.uniform(0.1, 1e4, n),
            r.uniform(0.01, 1.0, n),
            *(lambda b: b[1:])(bands(r, n)),
        ),
        radiometry.grey_body_intensity,
        lambda t, area, e, low, high: area * e * band(t, low, high),
        share=0.2,
    ),
    Case(
        "radiometry.two_colour_temperature",
        lambda r, n: (
            lambda t: (
                np.exp(r.normal(scale=0.3, size=n)) * radiometry.band_radiance(t, 2.0, 2.5),
                radiometry.band_radiance(t, 3.0, 5.0),
            )
        )(draws.log_uniform(r, n, 300.0, 4000.0)),
        lambda one, two: (
            radiometry.two_colour_temperature(
                one, two, 0.0 * one, 0.0 * two, SHORT, MID
            ).temperature_k
        ),
        two_colour,
        share=0.03,
    ),
    Case(
        "radiometry.solar_irradiance",
        lambda r, n: bands(r, n)[1:],
        radiometry.solar_irradiance,
        lambda low, high: (
            band(mp.mpf(5772), low, high)
            * mp.pi
            * (mp.mpf(SUN_RADIUS_M) / mp.mpf(ASTRONOMICAL_UNIT_M)) ** 2
        ),
        share=0.2,
    ),
    Case("radiometry.lambert_phase", lambda r, n: (phases(r, n),), radiometry.lambert_phase, phase),
    Case(
        "radiometry.stagnation_flux_w_m2",
        lambda r, n: _airflows(r, n),
        radiometry.stagnation_flux_w_m2,
        lambda density, speed, nose: min(
            mp.mpf(HEATED["stagnation_kg05_m"]) * mp.sqrt(density / nose) * speed**3,
            density * speed**3 / 2,
        ),
    ),
    Case(
        "radiometry.equilibrium_temperature_k",
        lambda r, n: (
            draws.log_uniform(r, n, 1e-3, 1e8),
            draws.log_uniform(r, n, 10.0, 1e4),
            draws.log_uniform(r, n, 0.1, 1.0),
            draws.log_uniform(r, n, 100.0, 300.0),
        ),
        radiometry.equilibrium_temperature_k,
        equilibrium,
    ),
    Case(
        "radiometry.lambert_sphere_intensity",
        lambda r, n: (*_positive(2)(r, n), phases(r, n)),
        radiometry.lambert_sphere_intensity,
        lambda e, area, angle: 2 / (3 * mp.pi) * e * area * phase(angle),
    ),
    _products("irradiance_at_aperture", 1, -2, 1),
    _products("irradiance_of_projected_area", 1, 1, -2),
    _products("irradiance_of_sphere", 1, 1, -2, factor=lambda: mp.mpf(1) / 4),
    _products("minimum_detectable_intensity", 1, 2, -1, 1),
    _products("electrons_per_w_m2", 1, 2, 1, 1, 1, factor=lambda: mp.pi / 4 / (H * C * 10**6)),
    _products("noise_equivalent_irradiance", 1, -1, -1, mp.mpf(1) / 2),
    _products("airy_sigma_rad", 1, -1, factor=lambda: mp.sqrt(2) / mp.pi * mp.mpf(10) ** -6),
    Case(
        "radiometry.blurred_sigma_rad",
        _positive(3, special=(0.0,)),
        radiometry.blurred_sigma_rad,
        lambda s, j, m: mp.sqrt(s * s + j * j + m * m / 24),
    ),
    Case(
        "radiometry.noise_electrons",
        _positive(4, special=(0.0,)),
        radiometry.noise_electrons,
        lambda b, d, r, s: mp.sqrt(b + d + s + r * r),
    ),
    Case(
        "radiometry.photon_centroid_variance",
        _positive(2),
        radiometry.photon_centroid_variance,
        lambda s, p: s * s + p * p / 12,
    ),
    Case(
        "radiometry.joined_centroid_variance",
        _positive(2, 1e-150, 1e150, (0.0, 1e-300)),
        radiometry.joined_centroid_variance,
        joined,
    ),
    *(
        Case(
            f"radiometry.ensquared_energy, {kind}",
            spots,
            lambda s, p, c, kind=kind: radiometry.ensquared_energy(s, p, c, kind),
            ensquared(kind),
            fixed=(2,),
        )
        for kind in ("mean", "best", "worst")
    ),
    Case(
        "radiometry.centroid_factor_rad",
        usual_spots,
        radiometry.centroid_factor_rad,
        centroid_factor,
        share=0.005,
    ),
    Case(
        "radiometry.mean_shares",
        lambda r, n: usual_spots(r, n),
        lambda s, p: np.array(
            [
                radiometry.mean_shares(5, *row).ravel()
                for row in zip(s.tolist(), p.tolist(), strict=True)
            ]
        ),
        lambda s, p: mean_share(5, s, p),
        share=0.2,
    ),
    Case(
        "radiometry.mean_shares, wide spots",
        lambda r, n: (draws.log_uniform(r, n, 1.0, 1e4), np.ones(n)),
        lambda s, p: np.array(
            [
                radiometry.mean_shares(3, *row).ravel()
                for row in zip(s.tolist(), p.tolist(), strict=True)
            ]
        ),
        lambda s, p: mean_share(3, s, p),
        share=0.2,
    ),
    Case(
        "radiometry.signal_gain",
        lambda r, n: usual_spots(r, n),
        lambda s, p: np.array(
            [
                radiometry.signal_gain(radiometry.filter_weights("surround", 1, *row), *row)
                for row in zip(s.tolist(), p.tolist(), strict=True)
            ]
        ),
        lambda s, p: (
            lambda all_: (
                all_[12]
                - mp.fsum(all_[k] for k in range(25) if k // 5 in (0, 4) or k % 5 in (0, 4)) / 16
            )
        )(mean_share(5, s, p)),
        share=0.2,
    ),
    Case(
        "radiometry.noise_gain",
        lambda r, n: (r.normal(size=(n, 9)),),
        lambda w: np.array([radiometry.noise_gain(row.reshape(3, 3)) for row in w]),
        lambda w: mp.fsum(value * value for value in w),
    ),
    Case(
        "radiometry.structure_spectrum",
        lambda r, n: (
            draws.log_uniform(r, n, 1e-9, 1e3, (0.0,)),
            draws.log_uniform(r, n, 1e-2, 1e6),
            r.uniform(2.01, 6.0, n),
        ),
        radiometry.structure_spectrum,
        lambda k, scale, power: (
            2 * mp.pi * (power - 2) * scale**2 * (1 + (k * scale) ** 2) ** (-power / 2)
        ),
    ),
    Case(
        "radiometry.structure_correlation",
        lambda r, n: (
            draws.log_uniform(r, n, 1e-9, 1e3, (0.0, 1e-200, 5e-324, 1e-100)),
            draws.log_uniform(r, n, 1e-1, 1e3),
            r.uniform(2.1, 6.0, n),
        ),
        radiometry.structure_correlation,
        matern,
        scale=(1e-290,),
        share=0.5,
    ),
    Case(
        "radiometry.band_transmittance",
        lambda r, n: (
            draws.uniform(r, n, 0.0, 1.1e5, (0.0, 1e5, 5e-324)),
            draws.uniform(r, n, -0.2, 0.5 * np.pi, (0.0, 1e-12)),
        ),
        lambda h, e: radiometry.band_transmittance(2.0, 2.4, h, e),
        transmittance,
        share=0.5,
    ),
)

BOUNDS = (
    bound_of(
        "radiometry.centroid_sigma_rad",
        "1e-12 of itself",
        lambda r, n: (draws.log_uniform(r, n, 1.0, 1e4), *usual_spots(r, n)),
        radiometry.centroid_sigma_rad,
        lambda snr, sigma, pixel: centroid_factor(sigma, pixel) / snr,
        lambda *columns: np.full(len(columns[0]), 1e-12),
        share=0.005,
    ),
)

LEFT_OUT = {
    "FilteredSpot": "a quadrature of images to 1e-3"
    " (tests/against/test_against_displaced_spots.py)",
    "FrameDifference": "through SpatialTransfer",
    "OwnPast": "a table of FilteredSpot",
    "Parallax": "a record",
    "Paths": "a record",
    **dict.fromkeys(
        ("brightness_temperature_k", "parallax", "pixel_temperature_k"),
        "pixels of civil imagers (tests/plugins/photons/radiometry/test_pixels.py)",
    ),
    "PointSpread": "through FilteredSpot",
    "SpatialTransfer": "a quadrature of images to 1e-4"
    " (tests/against/test_against_focal_plane_images.py)",
    "Temperature": "a record",
    "Views": "a record",
    **dict.fromkeys(
        (
            "conversion_noise_electrons",
            "dark_current_density_a_cm2",
            "dark_electrons_per_s",
            "warm_optics_photons_per_s",
        ),
        "products and one exponential (tests/plugins/photons/radiometry/test_detector.py)",
    ),
    "ensquared_airy_energy": "FilteredSpot of a square of ones",
    "filter_weights": "weights of whole numbers; the matched ones through mean_shares",
}
