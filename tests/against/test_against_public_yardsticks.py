"""opir's defaults against public figures of what it imitates: bolides, flares, fires, plumes'
trough, ground by day.
"""

import numpy as np
import pytest
from opir_photons.radiometry.configs import CLIMATES, PlumeConfig
from opir_photons.radiometry.earth import sky_tables
from opir_photons.radiometry.plume import plume_signatures
from opir_photons.radiometry.source_configs import BolideConfig, FireConfig, FlareConfig
from opir_photons.radiometry.sources import bolide_sources

import opir_core as opir
from opir_core.geometry import ecef_to_geodetic
from opir_core.plugin import Band, SignatureContext, SourceContext

#: CNEOS fireballs, 1044 events of 1988 to 2026: median and 95 % of heights and speeds; median
#: energy radiated.
BOLIDE_KM = (22.0, 35.2, 61.0)
BOLIDE_M_S = (11.8e3, 17.3e3, 30.2e3)
BOLIDE_J = 6.2e10

#: Temperatures of gas flares (Fisher and Wooster, 2018), K.
FLARE_K = (1600.0, 2200.0)

#: Radiative power of fires in MODIS pixels, 40 196 of 30 September 2020: median and 90th
#: percentile, W.
FIRE_W = (28.6e6, 145e6)

#: The dimmest of plumes over their best, at 70 to 90 km, from published images of SBIRS (G.
#: Forden).
TROUGH = (0.20, 0.28)

STEFAN_BOLTZMANN = 5.670374419e-8


def test_bolides_are_brightest_where_they_were_measured():
    config = BolideConfig(at=[{"lat_deg": 10.0, "lon_deg": 20.0}], start_s=10.0)
    bands = (Band("SWIR", 2.5, 3.0),)
    bolides = bolide_sources(
        config, SourceContext(bands=bands, id="b", path="b", epoch_us=0, duration_s=60.0, seed=1)
    )
    since_s = np.linspace(0.0, config.flash_s, 201)[1:-1]
    time_s = config.start_s + since_s
    row = np.zeros(len(time_s), dtype=np.int32)
    place = ecef_to_geodetic(bolides.trajectories.position_ecef_m(row, time_s))
    shown = bolides.signatures.intensity_w_sr(0, row, since_s, place.height_m, np.zeros(len(row)))
    height_km = place.height_m[np.argmax(shown)] / 1e3
    assert BOLIDE_KM[0] < height_km < BOLIDE_KM[2]
    assert height_km == pytest.approx(BOLIDE_KM[1], rel=0.05)
    assert config.speed_m_s == pytest.approx(BOLIDE_M_S[1], rel=0.01)
    # A sphere of cross-section A radiates 4 A σ T⁴; sin² in time has half of the peak on average.
    power_w = 4.0 * config.area_m2 * STEFAN_BOLTZMANN * config.temperature_k**4
    assert 0.5 * power_w * config.flash_s == pytest.approx(BOLIDE_J, rel=0.05)


def test_gas_flares_are_as_hot_as_measured():
    assert FLARE_K[0] <= FlareConfig(at=[]).temperature_k <= FLARE_K[1]


def test_a_fire_is_one_of_a_bright_pixel():
    fire = FireConfig(at=[])
    power_w = fire.area_m2 * fire.emissivity * STEFAN_BOLTZMANN * fire.temperature_k**4
    assert FIRE_W[0] < power_w < FIRE_W[1]


def test_gases_have_the_trough_of_the_published_images():
    """Of the gases: soot is gone by then, so that a kerosene plume falls farther from its
    brightest.
    """
    bands = (Band("SWIR", 2.5, 3.0),)
    context = SignatureContext(
        bands=bands,
        ids=("T",),
        paths=("t",),
        types=("ICBM",),
        profiles=("ICBM_liquid",),
        burn_time_s=np.array([250.0]),
    )
    signatures = plume_signatures([PlumeConfig(stages=1)], context)
    height_m = np.linspace(0.0, 150e3, 301)
    row = np.zeros(len(height_m), dtype=np.int32)
    shown = signatures.intensity_w_sr(
        0, row, np.full(len(row), 100.0), height_m, np.full(len(row), 0.5 * np.pi)
    )
    least = np.argmin(np.where(height_m > 40e3, shown, np.inf))
    assert 70e3 <= height_m[least] <= 90e3
    assert TROUGH[0] * (1.0 - 1e-9) <= shown[least] / shown.max() <= TROUGH[1]


@pytest.mark.parametrize("climate", CLIMATES)
def test_long_wave_ground_by_day_is_not_colder_than_by_night(climate):
    """Satellites measure 0 K or more over land and about 0 over sea."""
    for sky in ("clear", "std_cirrus", "cumulus_top2.7km", "altostratus_top3.0km"):
        for table in sky_tables(climate, sky):
            assert np.all(table.day >= 0.0), (sky, table.band)


#: All of the launches of short-range missiles of 1991 were seen by DSP (NOVA "False Alarms"; IEEE
#: Spectrum, 2000).
SEEN = 88
LAUNCHED = 88


def ranged(latitude_deg, longitude_deg, bearing_deg, range_km):
    """Return the place at a range and bearing on a sphere, deg."""
    angle = range_km / 6371.0
    bearing = np.radians(bearing_deg)
    latitude = np.radians(latitude_deg)
    sine = np.sin(latitude) * np.cos(angle) + np.cos(latitude) * np.sin(angle) * np.cos(bearing)
    across = np.sin(bearing) * np.sin(angle) * np.cos(latitude)
    east = np.degrees(np.arctan2(across, np.cos(angle) - np.sin(latitude) * sine))
    return {"lat_deg": float(np.degrees(np.arcsin(sine))), "lon_deg": float(longitude_deg + east)}


@pytest.mark.slow
@pytest.mark.parametrize(
    "cloud", [None, {"top_km": 3.0}, {"top_km": 10.0}], ids=["clear", "3 km", "10 km"]
)
def test_short_range_missiles_on_a_winter_night_are_seen_as_in_1991(cloud):
    """Twelve over 600 km by the sensor of the record; the share seen is within binomial chance of
    all of 88.
    """
    rng = np.random.default_rng(2)
    count = 12
    targets = []
    for number in range(count):
        latitude, longitude, bearing = rng.uniform(
            [32.0, 40.0, 200.0], [34.0, 42.0, 280.0]
        ).tolist()
        launch = {
            "lat_deg": latitude,
            "lon_deg": longitude,
            "time_s": float(rng.uniform(10.0, 20.0)),
        }
        aim = ranged(latitude, longitude, bearing, 600.0)
        targets.append({"id": f"T{number}", "type": "SRBM", "launch": launch, "aim": aim})
    scene = {
        "scene": "winter night",
        "epoch": "1991-01-20T20:00:00Z",
        "duration_s": 150,
        "seed": 2,
        "sensors": [{"model": "DSP", "id": "D", "preset": "heritage", "orbital_slot_deg": 60.0}],
        "targets": targets,
        "detection": {"model": "snr"},
        "atmosphere": {
            "model": "lowtran",
            "climate": "midlat_winter",
            **({"cloud": cloud} if cloud else {}),
        },
        "background": {"model": "earth", "climate": "midlat_winter"},
        "outputs": [],
    }
    plan = opir.compile_plan(opir.scene_from_mapping(scene))
    seen = opir.Engine(plan).advance(plan.end_ns).truth.target
    share = len(set(seen[seen >= 0].tolist())) / count
    assert share > SEEN / LAUNCHED - 0.05
