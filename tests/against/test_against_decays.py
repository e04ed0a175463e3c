"""What the classifier expects of re-entries, against falls from orbit by an own integration: the
heat of Sutton and Graves (NASA TR R-376, 1971), radiated by Stefan and Boltzmann's law, in the U.S.
Standard Atmosphere, 1976.
"""

import json

import numpy as np
from repository import ROOT

KINDS = ROOT / "plugins" / "opir_photons" / "opir_photons" / "data" / "hot_sources.json"

#: Densities of table I of the standard, kg/m³, every 10 km from the ground on.
DENSITY = (
    1.225, 0.4135, 8.891e-2, 1.841e-2, 3.996e-3, 1.027e-3, 3.097e-4, 8.283e-5, 1.846e-5,
    3.416e-6, 5.604e-7, 9.708e-8, 2.222e-8,
)  # fmt: skip
EARTH_M = 6.371e6
GRAVITY_M_S2 = 9.807
EMISSIVITY = 0.8
STEP_S = 0.5


def planck(temperature_k):
    """Return the radiance from 2.55 to 2.85 µm, W/m²/sr, of black bodies (n,)."""
    wave_m = np.linspace(2.55e-6, 2.85e-6, 31)
    exponent = 1.438777e-2 / (wave_m * np.asarray(temperature_k)[:, None])
    return np.trapezoid(1.191043e-16 / wave_m**5 / np.expm1(exponent), wave_m, axis=1)


def decay(rng):
    """Return rows of temperature, K, height, m, and intensity, W/sr, every half second."""
    speed = rng.uniform(7300.0, 7800.0)
    descent = np.radians(rng.uniform(0.1, 2.0))
    coefficient = np.exp(rng.uniform(*np.log([30.0, 300.0])))
    area_m2 = np.exp(rng.uniform(*np.log([0.5, 10.0])))
    nose_m = 0.5 * np.sqrt(area_m2 / np.pi)
    height = 120e3
    rows = []
    while height > 10e3 and speed > 800.0 and len(rows) < 4000:
        density = np.exp(np.interp(height, 1e4 * np.arange(len(DENSITY)), np.log(DENSITY)))
        flux = 1.7415e-4 * np.sqrt(density / nose_m) * speed**3
        rows.append(((300.0**4 + flux / (EMISSIVITY * 5.670374e-8)) ** 0.25, height))
        radius = EARTH_M + height
        gravity = GRAVITY_M_S2 * (EARTH_M / radius) ** 2
        drag = 0.5 * density * speed**2 / coefficient
        turn = (gravity - speed**2 / radius) * np.cos(descent) / speed
        speed += (gravity * np.sin(descent) - drag) * STEP_S
        height -= speed * np.sin(descent) * STEP_S
        descent += turn * STEP_S
    temperature, heights = np.array(rows).T
    return temperature, heights, EMISSIVITY * area_m2 * planck(temperature), EMISSIVITY * area_m2


def test_re_entries_are_as_hot_high_and_lasting_as_decays():
    """While they radiate 3 kW/sr near 2.7 µm."""
    kinds = json.loads(KINDS.read_text(encoding="utf-8"))["kinds"]
    kind = next(kind for kind in kinds if kind["name"] == "re-entry")
    rng = np.random.default_rng(90187)
    seconds, inside, areas = [], [], []
    for _ in range(60):
        temperature, height, light, area_m2 = decay(rng)
        bright = light > 3e3
        seconds.append(STEP_S * np.count_nonzero(bright))
        columns = ((temperature[bright], "temperature_k"), (height[bright], "height_m"))
        inside.append(
            [(kind[name][0] <= column) & (column <= kind[name][1]) for column, name in columns]
        )
        areas.append(area_m2)
    shares = np.concatenate(inside, axis=1).mean(axis=1)
    assert np.all(shares > 0.9)
    # Limits that hold all are too wide.
    assert np.all(shares < 0.999)
    assert 0.8 < np.median(seconds) / kind["shining_s"] < 1.25
    of_spreads = ((seconds, "shining_s", "shining_spread"), (areas, "area_m2", "spread"))
    for column, median, spread in of_spreads:
        off = np.abs(np.log(np.array(column) / kind[median]))
        assert 0.8 < np.mean(off < np.log(kind[spread])) < 1.0
