"""The model `snr` at its extremes, asked as a scene assembles it: finite, in [0, 1], monotone,
exact in the tails.

Looks are laid by hand: at a gas flare, whose brightness does not change, from under the ground to
1000 km, from straight below the sensor to beyond its limb.
"""

from typing import Any

import mpmath
import numpy as np
import pytest
from opir_photons.radiometry.lowtran import LowtranAtmosphere
from scipy.special import log_ndtr, ndtr

import opir_core as opir
from opir_core import Engine
from opir_core.errors import SceneError
from opir_core.geometry import ecef_to_geodetic, elevation_rad, geodetic_to_ecef
from opir_core.plugin import Exposures

SENSORS = {
    "DSP": {
        "model": "DSP",
        "preset": "paper",
        "scan_phase": "random",
        "id": "D",
        "orbital_slot_deg": 0.0,
    },
    "SBIRS-GEO": {"model": "SBIRS-GEO", "id": "S", "orbital_slot_deg": 0.0},
    "NEXTGEN-GEO": {"model": "NEXTGEN-GEO", "id": "N", "orbital_slot_deg": 0.0},
}
HEIGHTS_M = np.array(
    [0.0, 1.0, 500.0, 2e3, 5e3, 8e3, 9_999.0, 10_001.0, 20e3, 50e3, 99_999.9, 100e3, 400e3, 1000e3]
)
LONGITUDES_DEG = (0.0, 40.0, 75.0, 81.2, 81.3, 82.0, 90.0)


def assembled(sensors: list[dict[str, Any]], **changes: Any) -> Any:
    """Return the plan of a scene with a gas flare as its only target."""
    mapping = {
        "scene": "extreme",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 1.0,
        "seed": 5,
        "sensors": sensors,
        "targets": [],
        "sources": [{"id": "flare", "model": "flares", "at": [{"lat_deg": 0.0, "lon_deg": 20.0}]}],
        "detection": {"model": "snr", "exact": True},
        "outputs": [],
    }
    return opir.compile_plan(
        opir.scene_from_mapping({"limits": {"false_alarms_per_s": 1e12}, **mapping, **changes})
    )


def looks_at(height_m: np.ndarray, longitude_deg: float, sensor: int = 0) -> Exposures:
    """Return looks of one sensor at heights over a place on the equator."""
    target = geodetic_to_ecef(0.0, np.radians(longitude_deg), height_m)
    at = np.broadcast_to(geodetic_to_ecef(0.0, 0.0, 35_786e3), target.shape)
    rows = len(height_m)
    time_s = np.full(len(height_m), 0.5)
    return Exposures(
        time_s=time_s,
        emission_time_s=time_s,
        scan=np.arange(rows),
        sensor=np.full(rows, sensor, dtype=np.int32),
        target=np.zeros(rows, dtype=np.int32),
        range_m=np.linalg.norm(target - at, axis=1),
        elevation_sine=np.sin(elevation_rad(target, at)),
        target_ecef_m=target,
        sensor_ecef_m=at,
    )


def chances(plan: Any, looks: Exposures) -> np.ndarray:
    """Return probabilities of detection, held to be probabilities, with signals and noise that are
    numbers.
    """
    response = plan.detection.response(looks)
    assert not np.isnan(response.probit).any()
    assert np.isfinite(response.snr).all()
    assert (response.snr >= 0.0).all()
    assert np.isfinite(response.noise_w_m2).all()
    assert (response.noise_w_m2 > 0.0).all()
    chance = plan.detection.probability(looks)
    assert ((chance >= 0.0) & (chance <= 1.0)).all()
    return chance


@pytest.fixture(scope="module")
def flare_w_m2() -> float:
    """Return what the flare, on the ground at 10 degrees of longitude, shines with in DSP's band
    through no air.
    """
    plan = assembled([{**SENSORS["DSP"], "nei_w_m2": 1.0}])
    return float(plan.detection.response(looks_at(np.array([0.0]), 10.0)).snr[0, 0])


SKIES: dict[str, dict[str, Any]] = {
    "empty": {},
    "air": {"atmosphere": "lowtran", "background": "earth"},
    "cloud": {"atmosphere": {"model": "lowtran", "cloud": {"top_km": 10.0}}, "background": "earth"},
}


@pytest.mark.slow
@pytest.mark.parametrize("sky", SKIES)
@pytest.mark.parametrize("name", SENSORS)
@pytest.mark.parametrize("nei", [0.0, pytest.param(1e-30, marks=pytest.mark.slow), 1e6])
def test_probabilities_everywhere(name: str, sky: str, nei: float) -> None:
    plan = assembled([{**SENSORS[name], "nei_w_m2": nei, "band_nei_w_m2": {}}], **SKIES[sky])
    for longitude_deg in LONGITUDES_DEG:
        chance = chances(plan, looks_at(HEIGHTS_M, longitude_deg))
        if name == "DSP" and sky == "empty":
            # Nothing is between, and the range falls with height.
            assert (np.diff(chance) >= -1e-12).all()
        if nei == 1e6:
            # The air widens gates towards the horizon, by which noise passes them hardly more
            # often.
            near = 1e-9 if name == "DSP" or sky == "empty" else 0.01
            assert chance == pytest.approx(plan.detection.noise_chance[0], rel=near)


@pytest.mark.parametrize("longitude_deg", LONGITUDES_DEG[:3])
def test_higher_is_surer_through_the_air(longitude_deg: float) -> None:
    # Lines of sight end elsewhere on the ground for each height, where the background hardly
    # differs.
    plan = assembled([SENSORS["DSP"]], atmosphere="lowtran", background="earth")
    assert (np.diff(chances(plan, looks_at(HEIGHTS_M, longitude_deg))[:11]) >= 0.0).all()


@pytest.mark.parametrize("name", SENSORS)
def test_targets_inside_cloud_give_no_signal(name: str) -> None:
    plan = assembled([SENSORS[name]], **SKIES["cloud"])
    looks = looks_at(HEIGHTS_M, 40.0)
    hidden = HEIGHTS_M < 10e3
    assert (plan.detection.response(looks).snr[hidden] == 0.0).all()
    assert (plan.detection.response(looks).snr[~hidden, 0] > 0.0).all()
    alone = plan.detection.noise_chance[0]
    below = chances(plan, looks)[hidden]
    if name == "DSP":
        assert below == pytest.approx(alone, rel=1e-9)
    else:
        # Before a bright cloud the bands' noises have other ratios than in the dark; all chances
        # are small.
        assert (below < 1e-6).all()


@pytest.mark.slow
@pytest.mark.parametrize("threshold", [-1.0, 0.0, 5.0, 37.047096])
@pytest.mark.parametrize("decade", range(-12, 13, 3))
def test_from_1e_minus_12_to_1e12_the_tails_are_mpmaths(
    flare_w_m2: float, decade: int, threshold: float
) -> None:
    mpmath.mp.dps = 40
    selected = (
        {"threshold_sigma": threshold} if threshold >= 0.0 else {"false_alarm_probability": 1e-30}
    )
    plan = assembled([{**SENSORS["DSP"], "nei_w_m2": flare_w_m2 / 10.0**decade, **selected}])
    response = plan.detection.response(looks_at(np.array([0.0]), 10.0))
    snr = float(response.snr[0, 0])
    assert snr == pytest.approx(10.0**decade, rel=1e-12)
    margin = mpmath.mpf(snr) - mpmath.mpf(plan.sensors[0].radiometer.threshold)
    smaller = mpmath.erfc(abs(margin) / mpmath.sqrt(2)) / 2
    side = -1.0 if margin > 0 else 1.0
    # Up to 1e12 deviations below and above, the logarithms of both sides.
    assert log_ndtr(side * response.probit[0]) == pytest.approx(
        float(mpmath.log(smaller)), rel=3e-11
    )
    assert log_ndtr(-side * response.probit[0]) == pytest.approx(
        float(mpmath.log1p(-smaller)), rel=1e-8, abs=0.0
    )


@pytest.mark.slow
@pytest.mark.parametrize("decade", range(-12, 13, 4))
def test_two_bands_of_which_any_will_do_miss_together(decade: int) -> None:
    mpmath.mp.dps = 40
    sensor = {
        **SENSORS["SBIRS-GEO"],
        "spectral_discrimination": "none",
        "threshold_sigma": 5.0,
        "nei_w_m2": 1.0,
    }
    unit = assembled([{**sensor, "band_nei_w_m2": {}}])
    signals = unit.detection.response(looks_at(np.array([0.0]), 10.0)).snr[0]
    plan = assembled(
        [{**sensor, "band_nei_w_m2": {}, "nei_w_m2": float(signals[0]) / 10.0**decade}]
    )
    response = plan.detection.response(looks_at(np.array([0.0]), 10.0))
    margins = [mpmath.mpf(float(one)) - 5 for one in response.snr[0]]
    missed = mpmath.fprod(mpmath.erfc(margin / mpmath.sqrt(2)) / 2 for margin in margins)
    assert log_ndtr(-response.probit[0]) == pytest.approx(float(mpmath.log(missed)), rel=1e-9)
    assert log_ndtr(response.probit[0]) == pytest.approx(
        float(mpmath.log1p(-missed)), rel=1e-9, abs=1e-300
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["SBIRS-GEO", "NEXTGEN-GEO"])
def test_less_noise_is_surer_where_ratios_are_plausible(name: str) -> None:
    # Any positive irradiance will do: what is left are thresholds, and these are passed the surer
    # the less the noise.
    bands = list(assembled([SENSORS[name]]).sensors[0].bands)
    wide = {band.name: [0.0, 1e6] for band in bands[1:]}
    result = []
    for decade in range(-12, 13, 3):
        sensor = {
            **SENSORS[name],
            "plausible_ratios": wide,
            "nei_w_m2": 1e-12 * 10.0**-decade,
            "band_nei_w_m2": {},
        }
        result.append(chances(assembled([sensor]), looks_at(np.array([30e3]), 10.0))[0])
    assert (np.diff(result) >= 0.0).all()
    assert result[0] < 1e-6
    assert result[-1] == 1.0


def test_bands_without_width_are_refused() -> None:
    with pytest.raises(SceneError, match="bands"):
        assembled([{**SENSORS["DSP"], "bands": {"Z": [4.0, 4.0]}}])
    plan = assembled([{**SENSORS["DSP"], "bands": {"Z": [4.0, 4.0 + 1e-12]}}])
    assert chances(plan, looks_at(HEIGHTS_M, 40.0)) == pytest.approx(float(ndtr(-5.0)), rel=1e-6)


def test_runs_look_up_no_air_above_100_km(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[float] = []
    inner = LowtranAtmosphere._looked_up

    def counting(
        self: Any, band: int, height_m: np.ndarray, elevation_sine: np.ndarray
    ) -> np.ndarray:
        asked.extend(height_m[elevation_sine >= 0.0].tolist())
        return inner(self, band, height_m, elevation_sine)

    monkeypatch.setattr(LowtranAtmosphere, "_looked_up", counting)
    launch = {"lat_deg": 0.0, "lon_deg": 10.0, "time_s": 0.0}
    target = {
        "id": "T",
        "type": "ICBM",
        "launch": launch,
        "aim": {"lat_deg": 60.0, "lon_deg": 60.0},
    }
    scene = {"sources": [], "targets": [target], "duration_s": 170.0, "atmosphere": "lowtran"}
    plan = assembled(list(SENSORS.values()), **scene)
    window = Engine(plan).advance(plan.end_ns)
    truth = window.truth.take(window.truth.target >= 0)
    result = plan.targets.position_ecef_m(truth.target, truth.emission_time_s)
    assert ecef_to_geodetic(result).height_m.max() > 110e3
    assert 90e3 < max(asked) < 100e3
