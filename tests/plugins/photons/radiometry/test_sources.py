"""Sources: from lists; fires, flares and bolides; what does not go together; and scenes that name
them.
"""

import numpy as np
import opir_dsp.plugin
import opir_photons.radiometry.plugin as light
import pytest
from infrared_sources import HERE, context, field, intensity, region
from opir_photons.radiometry import band_radiance
from opir_photons.radiometry.source_configs import BolideConfig, FireConfig, FlareConfig
from opir_photons.radiometry.sources import bolide_sources, fire_sources, flare_sources

from opir_core import Host
from opir_core.geometry import ecef_to_geodetic, geodetic_to_ecef, local_axes
from opir_core.plugin import EMITTER_TYPES
from opir_core.reading import scene_from_mapping, scene_mapping

HOST = Host.of(opir_dsp.plugin, light)


def test_emitters_of_a_list_have_their_own_values_or_the_blocks():
    config = FireConfig(
        at=({"lat_deg": 1.0, "lon_deg": 2.0}, {"lat_deg": 3.0, "lon_deg": 4.0, "area_m2": 1.0}),
        area_m2=5.0,
    )
    sources = fire_sources(config, context())
    assert sources.ids == ("fires-1", "fires-2")
    reported = sources.trajectories.truth()
    assert [row["area_m2"] for row in reported] == [5.0, 1.0]
    assert reported[0]["type"] == "fire"
    assert sources.trajectories.type_code.tolist() == [EMITTER_TYPES.index("fire")] * 2
    where = ecef_to_geodetic(
        sources.trajectories.position_ecef_m(np.array([1], np.int32), np.zeros(1))
    )
    assert np.degrees([where.latitude_rad[0], where.longitude_rad[0]]) == pytest.approx([3.0, 4.0])


def test_a_fire_is_a_flat_grey_body():
    sources = fire_sources(
        FireConfig(at=HERE, temperature_k=900.0, emissivity=0.5, area_m2=200.0), context()
    )
    up = local_axes(sources.trajectories.start_ecef_m)[0, 2]
    (_, north, _) = local_axes(sources.trajectories.start_ecef_m)[0]
    total = 0.5 * 200.0 * band_radiance(900.0, 4.0, 5.0)
    assert intensity(sources, 1) == pytest.approx(total, rel=1e-12)
    assert intensity(sources, 1, to_sensor=(up + north) / np.sqrt(2.0)) == pytest.approx(
        total / np.sqrt(2.0), rel=1e-12
    )
    assert intensity(sources, 1, to_sensor=-up).tolist() == [0.0]


def test_a_flare_shines_to_all_sides():
    sources = flare_sources(FlareConfig(at=HERE), context())
    east = local_axes(sources.trajectories.start_ecef_m)[0, 0]
    assert intensity(sources, to_sensor=east).tolist() == intensity(sources).tolist()
    assert intensity(sources)[0] == pytest.approx(
        0.3 * 30.0 * band_radiance(1800.0, 2.5, 3.0), rel=1e-12
    )


def test_sources_shine_from_start_to_end():
    sources = flare_sources(FlareConfig(at=HERE, start_s=50.0, end_s=70.0), context())
    row = np.zeros(4, np.int32)
    times = np.array([49.9, 50.0, 70.0, 70.1])
    assert np.isfinite(sources.trajectories.position_ecef_m(row, times)[:, 0]).tolist() == [
        False,
        True,
        True,
        False,
    ]
    always = flare_sources(FlareConfig(at=HERE), context(duration_s=600.0)).trajectories
    assert always.ignition_s[0] < 0.0
    assert always.burnout_s[0] > 600.0


def test_a_bolide_flashes_on_its_way_down():
    config = BolideConfig(
        at=HERE, start_s=100.0, speed_m_s=18_000.0, descent_deg=30.0, heading_deg=90.0
    )
    sources = bolide_sources(config, context())
    times = np.array([100.0, 101.0, 102.0])
    place = ecef_to_geodetic(sources.trajectories.position_ecef_m(np.zeros(3, np.int32), times))
    assert place.height_m[1] == pytest.approx(config.height_m - 9_000.0, abs=50.0)
    assert place.longitude_rad[1] > place.longitude_rad[0]
    assert np.degrees(place.latitude_rad[1]) == pytest.approx(10.0, abs=1e-3)
    shown = [float(intensity(sources, time_s=time)[0]) for time in times]
    assert shown[0] == pytest.approx(0.0, abs=1e-6 * shown[1])
    assert shown[1] == pytest.approx(config.area_m2 * band_radiance(4500.0, 2.5, 3.0), rel=1e-12)
    assert shown[2] == pytest.approx(0.0, abs=1e-6 * shown[1])


def test_settings_that_do_not_go_together():
    with pytest.raises(
        ValueError, match="none of them is given; exactly one of at, csv and field is needed"
    ):
        FireConfig()
    with pytest.raises(ValueError, match="at and csv are given"):
        FireConfig(at=HERE, csv="fires.csv")
    with pytest.raises(ValueError, match=r"at\[0\]: lon_deg is missing"):
        FireConfig(at=({"lat_deg": 1.0},))
    with pytest.raises(ValueError, match=r"at\[0\]: lat: unknown; did you mean lat_deg\?"):
        FireConfig(at=({"lat": 1.0, "lon_deg": 2.0},))
    with pytest.raises(ValueError, match=r"at\[1\]: end_s 5 is not after start_s 9"):
        FireConfig(
            at=({"lat_deg": 1.0, "lon_deg": 2.0}, {"lat_deg": 1.0, "lon_deg": 2.0, "end_s": 5.0}),
            start_s=9.0,
        )
    with pytest.raises(ValueError, match="end_s 5 is not after start_s 9"):
        FireConfig(field=field(1.0), start_s=9.0, end_s=5.0)
    with pytest.raises(ValueError, match="south_deg 5 is not below north_deg 5"):
        region(5.0, 5.0)


def test_scenes_name_sources():
    scene = scene_from_mapping(
        {
            "scene": "hot",
            "epoch": "2026-04-01T12:00:00Z",
            "duration_s": 60.0,
            "atmosphere": {"model": "lowtran", "cloud": {"cover": 0.3}, "bands": {"VIS": "SWIR"}},
            "background": "earth",
            "detection": "constant",
            "sensors": [{"model": "DSP", "id": "S", "orbital_slot_deg": 0.0}],
            "sources": [
                {"id": "a", "model": "fires", "at": [{"lat_deg": 1.0, "lon_deg": 2}]},
                {
                    "id": "b",
                    "model": "bolides",
                    "field": {
                        "region": {"south_deg": -1, "north_deg": 1, "west_deg": 0, "east_deg": 1},
                        "per_million_km2": 3,
                    },
                },
            ],
        },
        host=HOST,
    )
    assert [source.model.config.temperature_k for source in scene.sources] == [1000.0, 4500.0]
    assert scene_from_mapping(scene_mapping(scene), host=HOST) == scene


def test_a_geostationary_sensor_sees_a_fire_below_it():
    sources = fire_sources(FireConfig(at=HERE), context())
    place = sources.trajectories.start_ecef_m[0]
    away = geodetic_to_ecef(0.0, np.radians(20.0), 35_786e3) - place
    seen = intensity(sources, to_sensor=away / np.linalg.norm(away))
    assert 0.9 < seen[0] / intensity(sources)[0] < 1.0
