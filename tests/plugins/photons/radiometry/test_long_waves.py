"""Long waves of exhaust in air: the table between its rows and beyond, bands of parts, energy."""

from itertools import pairwise

import numpy as np
import pytest
from opir_photons.laws import law
from opir_photons.radiometry.long_waves import has_long_waves, jet_spectra
from opir_photons.radiometry.propellants import propellants

from opir_core.plugin import Band

WHOLE = Band("whole", 5.0, 14.0)


def test_each_propellant_has_jets():
    assert set(jet_spectra()) == set(propellants())
    for jets in jet_spectra().values():
        assert jets.height_km.tolist() == law("plume_gases")["jet_heights_km"]


@pytest.mark.parametrize("name", sorted(propellants()))
def test_jets_shine_with_a_part_of_their_energy(name):
    """Heat and burning with the air are up to 2.5 times the jet power."""
    for power_w in (1e7, 1e9, 3e10, 1e12):
        light = jet_spectra()[name].intensities_w_sr(power_w, WHOLE)
        assert np.all(light > 0.0)
        assert np.all(np.pi**2 * light < 0.5 * power_w)


def test_intensities_between_powers_and_beyond():
    jets = jet_spectra()["kerosene"]
    one, some, ten = (jets.intensities_w_sr(power, WHOLE) for power in (1e9, 10**9.5, 1e10))
    assert np.all((one < some) & (some < ten))
    narrow = Band("column", 10.2, 10.4)
    ends = (jets.intensities_w_sr(power, narrow) for power in (1e9, 1e10))
    middle = jets.intensities_w_sr(10**9.5, narrow)
    assert middle == pytest.approx(np.sqrt(np.prod(list(ends), axis=0)), rel=1e-12)
    most, more = (jets.intensities_w_sr(power, WHOLE) for power in (1e11, 5e11))
    assert more == pytest.approx(5.0 * most, rel=1e-12)
    assert jets.intensities_w_sr(0.0, WHOLE).tolist() == [0.0] * len(jets.height_km)


def test_a_band_has_what_its_parts_have():
    jets = jet_spectra()["methane"]
    edges = (4.0, 5.77, 6.6, 8.35, 9.13, 20.0)
    parts = [
        jets.intensities_w_sr(3e9, Band("part", lower, upper)) for lower, upper in pairwise(edges)
    ]
    assert sum(parts) == pytest.approx(jets.intensities_w_sr(3e9, WHOLE), rel=1e-12)
    assert jets.intensities_w_sr(3e9, Band("short", 2.5, 3.0)).tolist() == [0.0] * 9
    assert not has_long_waves(Band("short", 2.5, 5.0))


@pytest.mark.parametrize("name", ["kerosene", "solid"])
def test_water_is_brightest_and_afterburning_ends(name):
    jets = jet_spectra()[name]
    water, window, carbon = (
        jets.intensities_w_sr(1e10, Band("", *edges)) / (edges[1] - edges[0])
        for edges in ((6.4, 6.8), (10.4, 10.8), (13.4, 13.8))
    )
    assert np.all(water > window)
    assert np.all(carbon > window)
    height = jets.height_km
    assert 20.0 <= height[window.argmax()] <= 40.0
    assert window[height == 60.0] < 0.3 * window.max()
