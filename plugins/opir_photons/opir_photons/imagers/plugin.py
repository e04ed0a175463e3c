"""The sensor models `GOES-ABI`, `AHI` and `MTG-FCI`: the short and the water bands of the imagers of
GOES-R, Himawari and Meteosat Third Generation, and the longer ones as a preset.

Bands, 2 km pixels at nadir, noise and cadence: T. J. Schmit et al., "A closer look at the ABI on
the GOES-R series", Bulletin of the American Meteorological Society 98 (2017), 681-698, and the
GOES-R Product Definition and Users' Guide; K. Bessho et al., "An introduction to Himawari-8/9",
Journal of the Meteorological Society of Japan 94 (2016), 151-183; K. Holmlund et al., "Meteosat
Third Generation (MTG)", Bulletin of the American Meteorological Society 102 (2021), E990-E1015. A
NEDT is a noise-equivalent irradiance over a pixel: NEDT · dL/dT · (56 µrad)², at 300 K where no
other temperature is given.
"""

from collections.abc import Iterable, Mapping
from typing import Any

from opir_core.plugin import (
    ScanningSensorConfig,
    SensorModel,
    cited,
    hookimpl,
    scanning_model,
    with_defaults,
)

ABI = "Schmit et al., BAMS 98 (2017) 681; GOES-R Product Definition and Users' Guide"
AHI = "Bessho et al., J. Meteor. Soc. Japan 94 (2016) 151"
FCI = "Holmlund et al., BAMS 102 (2021) E990"

#: Bands 7 to 10, µm: shortwave window; upper, middle and lower tropospheric water vapour.
BANDS = {"B07": (3.8, 4.0), "B08": (5.77, 6.6), "B09": (6.75, 7.15), "B10": (7.24, 7.44)}

#: Bands 11 to 16, µm: cloud phase, ozone, windows, carbon dioxide.
LONG_BANDS = {
    "B11": (8.3, 8.7),
    "B12": (9.42, 9.8),
    "B13": (10.1, 10.6),
    "B14": (10.8, 11.6),
    "B15": (11.8, 12.8),
    "B16": (13.0, 13.6),
}

#: NEDT of 0.1 K at 300 K in each band, and of 0.16 K in band 7 of AHI, as irradiances.
ABI_NEI_W_M2 = {"B07": 1.553e-12, "B08": 3.783e-11, "B09": 2.137e-11, "B10": 1.113e-11}
AHI_NEI_W_M2 = {**ABI_NEI_W_M2, "B07": 2.484e-12}

#: NEDT of 0.1 K at 300 K, 0.3 K in band 16, as irradiances.
LONG_NEI_W_M2 = {
    "B11": 2.26e-11,
    "B12": 1.986e-11,
    "B13": 2.407e-11,
    "B14": 3.438e-11,
    "B15": 3.642e-11,
    "B16": 5.575e-11,
}

#: Short-wave window and water vapour of the Flexible Combined Imager, µm, and its longer bands.
FCI_BANDS = {"IR38": (3.6, 4.0), "WV63": (5.8, 6.8), "WV73": (7.1, 7.6)}
FCI_LONG_BANDS = {
    "IR87": (8.5, 8.9),
    "IR97": (9.51, 9.81),
    "IR105": (10.15, 10.85),
    "IR123": (12.05, 12.55),
    "IR133": (13.0, 13.6),
}

#: NEDT of 0.1 K in IR38, IR87 and IR105, 0.2 K in IR123 and, at 270 K, IR133, 0.3 K at 250 K in WV63
#: and WV73 and at 255 K in IR97, as irradiances.
FCI_NEI_W_M2 = {"IR38": 2.649e-12, "WV63": 4.438e-11, "WV73": 3.251e-11}
FCI_LONG_NEI_W_M2 = {
    "IR87": 2.24e-11,
    "IR97": 2.675e-11,
    "IR105": 3.306e-11,
    "IR123": 3.64e-11,
    "IR133": 3.017e-11,
}

#: A pixel is sampled every 2 km at nadir, from 35 786 km.
PIXEL_URAD = 56.0

#: Colder detectors with larger wells, which the Earth's long waves do not fill; notional.
LONG_FOCAL_PLANE = {"subframes": 8, "detector_temperature_k": 60.0, "well_capacity_e": 1e8}

LONG_WAVES = {
    "long-waves": {
        "bands": LONG_BANDS,
        "band_nei_w_m2": LONG_NEI_W_M2,
        "focal_plane": LONG_FOCAL_PLANE,
    }
}

ABI_SCANS: Mapping[str, Mapping[str, Any]] = {
    "full-disk": {"scan_period_ms": 600_000.0},
    "conus": {"scan_period_ms": 300_000.0},
    "mesoscale": {"scan_period_ms": 60_000.0},
    "mesoscale-30s": {"scan_period_ms": 30_000.0},
    **LONG_WAVES,
}
AHI_SCANS: Mapping[str, Mapping[str, Any]] = {
    "full-disk": {"scan_period_ms": 600_000.0},
    "target-area": {"scan_period_ms": 150_000.0},
    "landmark": {"scan_period_ms": 30_000.0},
    **LONG_WAVES,
}
FCI_SCANS: Mapping[str, Mapping[str, Any]] = {
    "full-disk": {"scan_period_ms": 600_000.0},
    "rapid-scan": {"scan_period_ms": 150_000.0},
    "long-waves": {
        "bands": FCI_LONG_BANDS,
        "band_nei_w_m2": FCI_LONG_NEI_W_M2,
        "focal_plane": LONG_FOCAL_PLANE,
    },
}

#: Settings that all imagers have.
_IMAGER = {
    "scan_pattern": "step-stare",
    "detection_probability": {"ICBM": 0.5, "IRBM": 0.5, "SRBM": 0.5},
    "threshold_sigma": 7.0,
    "confirmation_detections": 1,
    "confirmation_scans": 1,
    "spectral_discrimination": "none",
}


@with_defaults(
    **_IMAGER,
    bands=cited(BANDS, ABI),
    scan_period_ms=cited(60_000.0, f"mesoscale sector; {ABI}"),
    # A third of the navigation error (1 km at nadir) with a pixel's width over the root of 12.
    line_of_sight_sigma_urad=cited(19.0, f"navigation 28 urad, 3 sigma, and pixel; {ABI}"),
    band_nei_w_m2=cited(ABI_NEI_W_M2, f"NEDT 0.1 K at 300 K; {ABI}"),
    ifov_urad=cited(PIXEL_URAD, ABI),
)
class AbiConfig(ScanningSensorConfig):
    """What a scene may set of a GOES-ABI imager."""


@with_defaults(
    **_IMAGER,
    bands=cited(BANDS, f"those of the ABI, within 0.1 µm; {AHI}"),
    scan_period_ms=cited(600_000.0, f"full disk; {AHI}"),
    line_of_sight_sigma_urad=19.0,
    band_nei_w_m2=cited(
        AHI_NEI_W_M2, f"NEDT 0.16 K at 300 K in band 7, 0.1 K in the others; {AHI}"
    ),
    ifov_urad=cited(PIXEL_URAD, AHI),
)
class AhiConfig(ScanningSensorConfig):
    """What a scene may set of an AHI imager."""


@with_defaults(
    **_IMAGER,
    bands=cited(FCI_BANDS, FCI),
    scan_period_ms=cited(600_000.0, f"full disk; {FCI}"),
    line_of_sight_sigma_urad=19.0,
    band_nei_w_m2=cited(
        FCI_NEI_W_M2, f"NEDT 0.1 K at 300 K, 0.3 K at 250 K in water vapour; {FCI}"
    ),
    ifov_urad=cited(PIXEL_URAD, FCI),
)
class FciConfig(ScanningSensorConfig):
    """What a scene may set of a Flexible Combined Imager."""


@hookimpl
def opir_sensor_models() -> Iterable[SensorModel]:
    """Yield `GOES-ABI`, `AHI` and `MTG-FCI`."""
    summary = "civil imager, 2 km at nadir (presets by scan)"
    yield scanning_model("GOES-ABI", summary, AbiConfig, presets=ABI_SCANS, subject="light")
    yield scanning_model("AHI", summary, AhiConfig, presets=AHI_SCANS, subject="light")
    yield scanning_model("MTG-FCI", summary, FciConfig, presets=FCI_SCANS, subject="light")
