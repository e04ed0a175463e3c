"""Plumes: the table's bands, other bands by the stated spectrum, thrust phases, altitude, aspect,
and bad settings.
"""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from attrs import fields
from hypothesis import given, strategies as st
from opir_photons.radiometry import planck, plume as plume_module, propellants as propellants_module
from opir_photons.radiometry.configs import PlumeConfig
from opir_photons.radiometry.long_waves import jet_spectra
from opir_photons.radiometry.plume import plume_intensity_w_sr, plume_signatures
from opir_photons.radiometry.propellants import continuum_w_sr, jet_power_w, propellants

import opir_core
from opir_core import Host
from opir_core.errors import ModelError
from opir_core.plugin import Band, SignatureContext
from opir_core.scene import info_of, plume_table
from opir_core.scene.target_classes import core_profiles

TABLE = json.loads(
    (Path(opir_core.__file__).parent / "data" / "plumes.json").read_text(encoding="utf-8")
)
BANDS = tuple(Band(name, *edges) for name, edges in TABLE["bands_um"].items())
CLASSES = tuple(TABLE["peak_w_sr"])
BEST_M = 25_000.0
LATE_S = 50.0


def context(count=1, bands=BANDS, profiles=None, types=None, burn_time_s=120.0):
    return SignatureContext(
        bands=bands,
        ids=tuple(f"T{row}" for row in range(count)),
        paths=tuple(f"targets[{row}].signature" for row in range(count)),
        types=types or ("ICBM",) * count,
        profiles=profiles or ("ICBM_solid",) * count,
        burn_time_s=np.full(count, burn_time_s),
    )


def intensity(signatures, band=0, time_s=LATE_S, altitude_m=BEST_M, aspect_rad=np.pi / 2, target=0):
    columns = np.broadcast_arrays(np.asarray(time_s, float), altitude_m, aspect_rad)
    rows = np.full(columns[0].size, target, dtype=np.int32)
    return signatures.intensity_w_sr(
        band, rows, *(np.ravel(column).astype(float) for column in columns)
    )


def plume(**settings):
    return plume_signatures([PlumeConfig(**settings)], context())


def test_plumes_of_a_class_share_their_integrals(monkeypatch):
    built = []
    exact = planck.band_radiance
    monkeypatch.setattr(
        plume_module, "band_radiance", lambda *place: built.append(place) or exact(*place)
    )

    def integrals(count):
        plume_module._radiance.cache_clear()
        built.clear()
        plume_signatures([PlumeConfig(continuum_temperature_k=1511.0)] * count, context(count))
        return len(built)

    assert integrals(100) == integrals(1) > 0


def test_every_class_profile_has_a_plume():
    assert set(CLASSES) == set(core_profiles())


@pytest.mark.parametrize("name", CLASSES)
def test_the_tables_bands_have_the_tables_intensities(name):
    clean = PlumeConfig(stages=1, rise_time_s=0.0, propellant="storable")
    signatures = plume_signatures([clean], context(profiles=(name,)))
    for number, band in enumerate(BANDS):
        assert intensity(signatures, number) == pytest.approx(
            TABLE["peak_w_sr"][name][band.name], rel=1e-12
        )


def test_jets_shine_beside_the_tables_bands():
    part = Band("part of LWIR", 8.0, 11.9)
    signatures = plume_signatures(
        [PlumeConfig(stages=1, rise_time_s=0.0, propellant="storable")],
        context(bands=(*BANDS, part)),
    )
    level = TABLE["peak_w_sr"]["ICBM_solid"]
    jets = jet_spectra()["storable"].intensities_w_sr(jet_power_w(level), part)
    at_20_km = float(intensity(signatures, 3, altitude_m=20e3)[0])
    assert jets[2] < at_20_km < jets[2] + 2.0 * level["LWIR"]


@pytest.mark.parametrize("name", CLASSES)
def test_a_band_has_what_its_parts_have(name):
    edges = np.array([1.5, 2.2, 2.6, 2.9, 3.3, 4.1, 4.3, 4.5, 5.0, 9.0, 14.0])
    peaks = TABLE["peak_w_sr"][name]
    parts = [
        plume_intensity_w_sr(peaks, Band("part", low, high), 1500.0, 2000.0)
        for low, high in pairwise(edges.tolist())
    ]
    total = plume_intensity_w_sr(peaks, Band("whole", edges[0], edges[-1]), 1500.0, 2000.0)
    assert sum(parts) == pytest.approx(total, rel=1e-12)
    assert min(parts) > 0.0


def test_intensity_follows_the_stages():
    signatures = plume(rise_time_s=0.0, body_area_m2=0.0)
    first, second, third = (
        float(intensity(signatures, time_s=at)[0]) for at in (20.0, 60.0, 100.0)
    )
    assert (second / first, third / first) == (pytest.approx(0.3), pytest.approx(0.1))
    assert intensity(signatures, time_s=[-1e-9, 120.0 + 1e-9, -50.0, 1e9]).tolist() == [0.0] * 4


def test_intensity_rises_at_ignition():
    result = intensity(
        plume(rise_time_s=2.0, stages=1, propellant="storable"), time_s=np.linspace(0.0, 30.0, 200)
    )
    assert result[0] == 0.0
    assert (np.diff(result) >= 0.0).all()
    assert result[-1] == pytest.approx(TABLE["peak_w_sr"]["ICBM_solid"]["SWIR"], rel=1e-6)


def test_afterburning_trough_and_recovery():
    at = {km: float(intensity(plume(), altitude_m=km * 1e3)[0]) for km in (25, 50, 80, 120)}
    assert at[25] > at[50] > at[120] > at[80]
    heights_km = np.array([-0.5, 0.0, 300.0, 1000.0])
    low, ground, high, beyond = intensity(plume(), altitude_m=heights_km * 1e3)
    assert (low, beyond) == (ground, high)


PLUME = plume()


@given(st.floats(0.0, np.pi))
def test_broadside_is_brightest_and_end_on_dimmest(aspect):
    signatures = PLUME
    side, nose, tail, result = intensity(signatures, aspect_rad=[np.pi / 2, 0.0, np.pi, aspect])
    assert nose / side == pytest.approx(0.1)
    assert tail / side == pytest.approx(0.3)
    assert nose <= result * (1.0 + 1e-12)
    assert result <= side


def test_rows_do_not_depend_on_their_company():
    configs = [
        PlumeConfig(),
        PlumeConfig(scale=2.0, altitude_km=(0.0, 50.0), altitude_scale=(1.0, 0.1), stages=2),
    ]
    both = plume_signatures(
        configs, context(2, profiles=("SRBM", "ICBM_liquid"), types=("SRBM", "ICBM"))
    )
    alone = plume_signatures(configs[1:], context(profiles=("ICBM_liquid",)))
    times = np.linspace(0.0, 119.0, 50)
    heights = np.linspace(0.0, 300e3, 50)
    assert (
        intensity(both, 1, times, heights, target=1).tolist()
        == intensity(alone, 1, times, heights).tolist()
    )
    one_by_one = [
        float(intensity(both, 1, t, h, target=1)[0]) for t, h in zip(times, heights, strict=True)
    ]
    assert intensity(both, 1, times, heights, target=1).tolist() == one_by_one


def test_unknown_profiles_have_the_plume_of_the_type():
    unknown = plume_signatures([PlumeConfig()], context(types=("IRBM",), profiles=("",)))
    named = plume_signatures(
        [PlumeConfig(profile="MRBM")], context(types=("ICBM",), profiles=("ICBM_solid",))
    )
    assert intensity(unknown).tolist() == intensity(named).tolist()


def test_settings_that_contradict_themselves():
    with pytest.raises(
        ModelError, match=r"targets\[0\].signature.profile: 'X' is not one of SRBM, MRBM"
    ):
        plume(profile="X")
    with pytest.raises(
        ModelError, match=r"targets\[0\].signature: the continuum that LWIR 1e\+06 W/sr implies"
    ):
        plume(peak_w_sr={"LWIR": 1e6})
    with pytest.raises(ValueError, match="each is to be above the one before it"):
        PlumeConfig(altitude_km=(0.0, 0.0), altitude_scale=(1.0, 1.0))
    with pytest.raises(ValueError, match="not lists of one length"):
        PlumeConfig(altitude_km=(0.0,))
    with pytest.raises(ValueError, match="'VIS' is not one of the bands"):
        PlumeConfig(peak_w_sr={"VIS": 1.0})


def test_defaults_of_the_configuration_are_the_tables():
    config = PlumeConfig()
    assert list(config.altitude_km) == plume_table()["altitude_km"]
    assert list(config.altitude_scale) == plume_table()["altitude_scale"]
    assert list(config.stage_scale) == plume_table()["stage_scale"]
    assert all(
        info_of(attribute).help and info_of(attribute).source for attribute in fields(PlumeConfig)
    )


def test_the_host_finds_it():
    component = Host.discover().component("opir_signature_models", "plume")
    assert component.build([component.config()], context()).burn_time_s.tolist() == [120.0]


def test_after_burnout_the_warm_body_alone_is_seen():
    bands = (Band("MWIR", 4.0, 5.0), Band("LWIR", 8.0, 12.0))
    config = PlumeConfig(body_temperature_k=320.0, body_area_m2=3.0, body_emissivity=0.8)
    context = SignatureContext(
        bands=bands,
        ids=("T",),
        paths=("t",),
        types=("ICBM",),
        profiles=("",),
        burn_time_s=np.array([180.0]),
    )
    plume = plume_signatures([config], context)
    everyone = np.zeros(2, dtype=np.int32)
    # Half an hour later the nozzle is cold.
    time_s = np.array([2000.0, 3000.0])
    altitude_m = np.array([2e5, 9e5])
    aspect_rad = np.array([0.1, 1.5])
    for number, band in enumerate(bands):
        reported = plume.intensity_w_sr(number, everyone, time_s, altitude_m, aspect_rad)
        wavelength_um = np.linspace(band.lower_um, band.upper_um, 20001)
        # Planck's law in W m⁻² sr⁻¹ µm⁻¹, summed by the trapezoidal rule.
        c1 = 1.191042972e8
        c2 = 1.438776877e4
        radiance = c1 / wavelength_um**5 / np.expm1(c2 / (wavelength_um * 320.0))
        assert reported == pytest.approx(
            0.8 * 3.0 * np.trapezoid(radiance, wavelength_um), rel=1e-7
        )


WINDOW = Band("window", 3.8, 4.0)
WIDE = (*BANDS, WINDOW, Band("water", 5.77, 6.6))


def spectrum_of(signatures, **place):
    return np.array(
        [float(intensity(signatures, number, **place)[0]) for number in range(len(WIDE))]
    )


def of_propellant(name, profile="SLV"):
    config = PlumeConfig(stages=1, rise_time_s=0.0, propellant=name)
    return plume_signatures([config], context(profiles=(profile,), bands=WIDE))


def test_soot_dies_with_height_and_leaves_the_gases():
    sooty = of_propellant("kerosene")
    clean = of_propellant("storable")
    low, high = (
        spectrum_of(sooty, altitude_m=at) / spectrum_of(clean, altitude_m=at) for at in (5e3, 100e3)
    )
    assert low[3] > 10.0  # between the gases' bands soot is nearly all
    assert high == pytest.approx(np.ones(len(WIDE)), abs=0.25)
    window, swir = (
        float(
            intensity(sooty, number, altitude_m=5e3)[0]
            / intensity(sooty, number, altitude_m=60e3)[0]
        )
        for number in (3, 0)
    )
    assert window > 1.5 * swir  # so the ratio of the two tells the height


def test_alumina_outlives_afterburning():
    share = [
        spectrum_of(of_propellant(fuel), altitude_m=100e3)[3]
        for fuel in ("solid", "kerosene", "storable")
    ]
    assert share[0] > 3.0 * share[1] > 3.0 * share[2] * 0.9


def test_the_continuum_has_its_share_of_jet_power():
    """Broadside is 4/π of the mean, which all wavelengths together and 4π sr make the radiated
    power.
    """
    table = json.loads(
        (Path(propellants_module.__file__).parents[1] / "data" / "propellants.json").read_text(
            "utf-8"
        )
    )
    power_w = 3e9
    for name, row in table["propellants"].items():
        result = (
            continuum_w_sr(propellants()[name], power_w, 0.4, 60.0)
            * np.pi
            / 4.0
            * 4.0
            * np.pi
            / power_w
        )
        assert result == pytest.approx(row.get("radiated_share_of_jet_power", 0.0), rel=0.01)
        assert row["source"]
        assert row["spread"] > 1.0


@pytest.mark.parametrize("name", ["kerosene", "solid"])
def test_the_continuums_colour_is_that_of_its_particles(name):
    """Soot of optical depth 1 at 4 µm is 1 - exp(-4/λ) of a black body, thin alumina a grey one."""
    fuel = propellants()[name]

    def summed(lower, upper):
        wavelength = np.linspace(lower, upper, 20_001)
        black = wavelength**-5 / np.expm1(14_387.768775 / (wavelength * fuel.temperature_k))
        return np.trapezoid(
            black * (1.0 - np.exp(-4.0 / wavelength) if name == "kerosene" else 1.0), wavelength
        )

    computed = continuum_w_sr(fuel, 1e9, 3.8, 4.0) / continuum_w_sr(fuel, 1e9, 8.0, 12.0)
    assert computed == pytest.approx(summed(3.8, 4.0) / summed(8.0, 12.0), rel=1e-6)


def test_classes_have_propellants_and_peaks_of_gases():
    of_class = plume_signatures([PlumeConfig(stages=1)], context(profiles=("SLV",), bands=WIDE))
    assert (
        spectrum_of(of_class).tolist()
        == spectrum_of(
            plume_signatures(
                [PlumeConfig(stages=1, propellant="kerosene")],
                context(profiles=("SLV",), bands=WIDE),
            )
        ).tolist()
    )
    doubled = {band: 2.0 * peak for band, peak in TABLE["peak_w_sr"]["SLV"].items()}
    given = PlumeConfig(stages=1, peak_w_sr=doubled)
    twice = spectrum_of(plume_signatures([given], context(profiles=("SLV",), bands=WIDE)))
    ratio = twice / spectrum_of(of_class)
    # Mixing goes with the root of the power: jets of twice the power are more than twice as bright.
    assert ratio[:4] == pytest.approx(2.0, rel=1e-9)
    assert 2.0 < ratio[4] < 4.0


def test_hot_water_without_air_is_thin_gas():
    """By hand, at 1000 K: 41.2 · 1600³ / (e^2.302 - 1) over 35.66 · 3760³ / (e^5.410 - 1) is 2.20
    of near 2.7 µm, at 750 K 5.88."""
    bands = (Band("near 2.7", 2.45, 3.15), Band("near 6.3", 4.9, 7.8))
    peaks = {"SWIR": 1e5, "MWIR": 0.0, "LWIR": 0.0}
    for gas_k, ratio in ((2000.0, 2.203), (1500.0, 5.88)):
        config = PlumeConfig(
            stages=1,
            rise_time_s=0.0,
            peak_w_sr=peaks,
            propellant="storable",
            gas_temperature_k=gas_k,
        )
        signatures = plume_signatures([config], context(bands=bands))
        near_3, near_6 = (
            float(intensity(signatures, number, altitude_m=100e3)[0]) for number in (0, 1)
        )
        assert near_6 / near_3 == pytest.approx(ratio, rel=0.005)


def test_long_waves_pass_from_jets_to_expanding_gas():
    bands = (Band("near 6.3", 5.77, 6.6), Band("window", 10.1, 10.6))
    signatures = plume_signatures(
        [PlumeConfig(stages=1, rise_time_s=0.0)], context(profiles=("SLV",), bands=bands)
    )
    jet_w_sr, middle, expanding = (
        float(intensity(signatures, altitude_m=at)[0]) for at in (80e3, 90e3, 100e3)
    )
    assert middle == pytest.approx(0.5 * (jet_w_sr + expanding), rel=0.01)
    dark = plume_signatures([PlumeConfig(stages=1, rise_time_s=0.0)], context(profiles=("SLV",)))
    # What bands other sensors have does not change where light bends.
    assert signatures.altitude_breakpoints_m.tolist() == dark.altitude_breakpoints_m.tolist()
