"""What a scene may set of plumes. Nothing heavy is imported here.

What a scene may set of the sky: atmosphere, clouds and background. Nothing heavy is imported here.
"""

from collections.abc import Mapping
from typing import Any

from attrs import Factory, frozen

from opir_core.plugin import nested, number, text

_TABLE = "opir_core/data/plumes.json; notional"
_TABLE_BANDS = ("SWIR", "MWIR", "LWIR")


def _peaks_complaint(peaks: Mapping[str, Any]) -> str | None:
    unknown = [name for name in peaks if name not in _TABLE_BANDS]
    return f"{unknown[0]!r} is not one of the bands {', '.join(_TABLE_BANDS)}" if unknown else None


@frozen
class PlumeConfig:
    """What a scene may set of the signature model `plume`.

    The intensities of the gases are fixed in three bands, SWIR 2.5-3.0, MWIR 4.2-4.45 and LWIR 8-12
    µm, and a spectrum through them gives those of other bands: a grey continuum of
    `continuum_temperature_k` that has all of LWIR, and the gases' bands near 2.7 and 4.3 µm at
    `gas_temperature_k`, which have what the continuum leaves of SWIR and MWIR. To these the
    propellant adds the continuum of its particles, and, from 5 to 14 µm in bands other than LWIR
    itself, hot water and carbon dioxide of exhaust that mixes with the air, by jet power and
    height.
    """

    propellant: str | None = text(
        default=None,
        choices=("kerosene", "methane", "solid", "storable", "hydrogen"),
        help="propellant, whose particles (soot, alumina) add a continuum to the gases' bands, by"
        " the jet power that goes with their peak in SWIR; storable and hydrogen have none;"
        " default: that of the class, storable for those of other plugins",
        source="opir_photons/data/propellants.json, with the source and the spread of each level",
    )

    profile: str | None = text(
        default=None,
        help="class of plume, by profile: SRBM, MRBM, IRBM, SLBM, HGV, SLV, ICBM_solid or"
        " ICBM_liquid; by default that"
        " of the profile that the target flies, or of the first of its class",
        source="no default: the target's",
    )
    scale: float = number(
        default=1.0,
        minimum=0.0,
        maximum=1e6,
        help="factor on the jet power and on all intensities; from 5 to 14 µm, where mixing counts,"
        " they grow faster",
        source="the table's own",
    )
    peak_w_sr: Mapping[str, float] = nested(
        default=Factory(dict),
        unit="W/sr",
        minimum=0.0,
        maximum=1e12,
        check=_peaks_complaint,
        help="by SWIR, MWIR, LWIR the gases' intensity of the first stage, seen broadside, at the"
        " best altitude; what is not given is the class's",
        source=_TABLE,
    )
    stages: int | None = number(
        default=None,
        minimum=1,
        maximum=8,
        help="stages, of equal shares of the burn; default: the burns of the flight, of a single"
        " one the class's",
        source=_TABLE,
    )
    stage_scale: tuple[float, ...] = nested(
        default=(1.0, 0.3, 0.1),
        minimum=0.0,
        maximum=1e3,
        check=lambda scales: None if scales else "at least one stage is needed",
        help="each stage's intensity over the first's; the last goes for those after it too",
        source=_TABLE,
    )
    rise_time_s: float = number(
        default=1.0,
        unit="s",
        minimum=0.0,
        maximum=60.0,
        help="time constant with which the intensity rises at ignition",
    )
    altitude_km: tuple[float, ...] = nested(
        default=(
            0.0,
            10.0,
            20.0,
            30.0,
            40.0,
            50.0,
            60.0,
            70.0,
            80.0,
            90.0,
            100.0,
            120.0,
            150.0,
            200.0,
            300.0,
        ),
        unit="km",
        minimum=-1.0,
        maximum=100_000.0,
        help="rising altitudes at which altitude_scale stands; straight between, constant beyond"
        " the ends",
        source=_TABLE,
    )
    altitude_scale: tuple[float, ...] = nested(
        default=(0.6, 0.8, 1.0, 1.0, 0.9, 0.7, 0.45, 0.28, 0.2, 0.22, 0.27, 0.33, 0.33, 0.3, 0.25),
        minimum=0.0,
        maximum=1e3,
        help="intensity over its best: afterburning low down, a trough at 70 to 90 km, recovery in"
        " vacuum",
        source=_TABLE,
    )
    nose_on: float = number(
        default=0.1,
        minimum=0.0,
        maximum=1.0,
        help="intensity seen from straight ahead over that seen broadside",
    )
    tail_on: float = number(
        default=0.3,
        minimum=0.0,
        maximum=1.0,
        help="intensity seen from straight behind over that seen broadside",
    )
    body_temperature_k: float | None = number(
        default=None,
        unit="K",
        minimum=100.0,
        maximum=6000.0,
        help="temperature of the body after burnout where the air does not heat it; by default the"
        " class's, 300 K",
        source=_TABLE,
        subject="bodies",
    )
    body_area_m2: float = number(
        default=4.0,
        unit="m2",
        minimum=0.0,
        maximum=1e4,
        help="area that the body shows after burnout, projected, the mean over aspects: a quarter"
        " of its surface",
        subject="bodies",
    )
    body_emissivity: float = number(
        default=0.9,
        minimum=0.0,
        maximum=1.0,
        help="emissivity of the body after burnout",
        subject="bodies",
    )
    body_albedo: float = number(
        default=0.1,
        minimum=0.0,
        maximum=1.0,
        source="notional: 1 - 0.9, what is not absorbed by a grey body of the default emissivity"
        " (Kirchhoff)",
        help="share of the sunlight that the body reflects after burnout, diffusely, in every band",
        subject="bodies",
    )
    continuum_temperature_k: float = number(
        default=1500.0,
        unit="K",
        minimum=300.0,
        maximum=6000.0,
        help="temperature of the grey continuum, of particles",
    )
    gas_temperature_k: float = number(
        default=2000.0,
        unit="K",
        minimum=300.0,
        maximum=6000.0,
        help="temperature of the gases in their bands",
    )

    def __attrs_post_init__(self) -> None:
        if len(self.altitude_km) != len(self.altitude_scale) or not self.altitude_km:
            raise ValueError("altitude_km and altitude_scale are not lists of one length")
        if any(
            high <= low for low, high in zip(self.altitude_km, self.altitude_km[1:], strict=False)
        ):
            raise ValueError("altitude_km: each is to be above the one before it")


LOWTRAN = "LOWTRAN7 as shipped in opir_core/data"
CLIMATES = (
    "us1976",
    "tropical",
    "midlat_summer",
    "midlat_winter",
    "subarctic_summer",
    "subarctic_winter",
)
#: Which air is whose: the model atmospheres' own latitudes and months.
SEASONS = (
    "model atmosphere: tropical to 30 deg of latitude, midlat to 50 deg, subarctic beyond; summer"
    " from April to September, in the south from October to March; us1976 anywhere"
)
TABLE_BANDS = ("SWIR", "SWIR_N", "MWIR", "MWIR_N", "LWIR", "STG_2.0_2.4", "MWIRW_3.5_4.0")
#: Bands of civil imagers; the table of backgrounds has them under clear skies and opaque cloud
#: alone.
IMAGER_BANDS = (
    *(f"ABI_{number:02}" for number in range(7, 17)),
    *(f"FCI_{name}" for name in (38, 63, 73, 87, 97, 105, 123)),
)


def _stand_ins_complaint(bands: Mapping[str, Any]) -> str | None:
    known = (*TABLE_BANDS, *IMAGER_BANDS)
    unknown = [name for name in bands.values() if name not in known]
    return f"{unknown[0]!r} is not one of {', '.join(known)}" if unknown else None


@frozen
class CloudConfig:
    """A thin opaque deck of cloud that hides what is below its top."""

    top_km: float = number(
        default=10.0,
        unit="km",
        above=0.0,
        maximum=20.0,
        help="height of the top",
        read_if=("with a cover above 0", lambda cloud: cloud.cover > 0.0),
    )
    cover: float = number(
        default=1.0,
        minimum=0.0,
        maximum=1.0,
        help="share of the Earth that is covered: cells are drawn independently, once a run",
    )
    cell_km: float = number(
        default=100.0,
        unit="km",
        minimum=10.0,
        maximum=5000.0,
        help="size of a cell",
        read_if=("with a cover below 1", lambda cloud: 0.0 < cloud.cover < 1.0),
    )


@frozen
class LowtranConfig:
    """What a scene may set of the atmosphere `lowtran`."""

    climate: str = text(default="us1976", choices=CLIMATES, help=SEASONS, source=LOWTRAN)
    aerosol: str = text(
        default="rural23km",
        choices=("rural23km", "none"),
        help="aerosol: rural with a visibility of 23 km, or none (climate us1976 alone)",
        source=LOWTRAN,
    )
    weighting: str = text(
        default="flat",
        choices=("flat", "blackbody-1500K"),
        help="spectrum of the source that in-band means are taken with",
        source=LOWTRAN,
    )
    bands: Mapping[str, str] = nested(
        default=Factory(dict),
        check=_stand_ins_complaint,
        help="by the name of a sensor's band the band of LOWTRAN's table that stands for it, where"
        " its edges are not in the table",
        source="no default: bands are found by their edges",
    )
    cloud: CloudConfig | None = nested(
        default=None, help="a deck of cloud", source="none: a clear sky"
    )

    def __attrs_post_init__(self) -> None:
        if self.aerosol == "none" and self.climate != "us1976":
            raise ValueError(
                f"aerosol: none goes with the climate us1976 alone, not with {self.climate}; leave"
                f" it out"
            )


@frozen
class StructureConfig:
    """The structure of a part of the background: its power spectrum falls as k^-`exponent` beyond
    1/`scale_km`.
    """

    thermal_rms: float = number(
        default=0.03,
        minimum=0.0,
        maximum=10.0,
        help="standard deviation of emitted radiance, as a share of it",
    )
    solar_rms: float = number(
        default=0.15,
        minimum=0.0,
        maximum=10.0,
        help="standard deviation of reflected sunlight, as a share of it",
    )
    scale_km: float = number(
        default=10.0,
        unit="km",
        minimum=0.001,
        maximum=1e5,
        help="outer scale: structure correlates over about this",
    )
    exponent: float = number(
        default=3.0,
        minimum=2.1,
        maximum=6.0,
        help="exponent of the two-dimensional power spectrum of radiance",
    )


@frozen
class LimbStructureConfig(StructureConfig):
    """The structure beyond the limb: shares are of the radiance at the horizon."""

    height_km: float = number(
        default=8.0,
        unit="km",
        minimum=0.1,
        maximum=1000.0,
        help="tangent height over which the structure falls to 1/e",
    )


@frozen
class StructuresConfig:
    """The structure of the background, which sensors with a focal plane see as clutter."""

    surface: str = text(
        default="terrain",
        choices=("terrain", "sea"),
        help="what is below a sky without opaque cloud",
        subject="sky",
    )
    cloud: StructureConfig = nested(
        default=StructureConfig(thermal_rms=0.1, solar_rms=0.3, scale_km=10.0, exponent=3.0),
        source="notional; exponent 3: sharp edges (Debye, Anderson and Brumberger, J. Appl. Phys."
        " 28 (1957) 679)",
        help="opaque cloud and the other cloudy skies, with their edges",
        subject="any cloud",
    )
    terrain: StructureConfig = nested(
        default=StructureConfig(thermal_rms=0.03, solar_rms=0.15, scale_km=10.0, exponent=3.0),
        help="land below a clear sky",
        subject="sky",
        read_if=("with surface: terrain", lambda structure: structure.surface == "terrain"),
    )
    sea: StructureConfig = nested(
        default=StructureConfig(
            thermal_rms=0.01, solar_rms=0.05, scale_km=30.0, exponent=8.0 / 3.0
        ),
        help="sea below a clear sky",
        subject="sky",
        read_if=("with surface: sea", lambda structure: structure.surface == "sea"),
    )
    limb: LimbStructureConfig = nested(
        default=LimbStructureConfig(thermal_rms=0.02, solar_rms=0.05, scale_km=30.0, exponent=3.0),
        help="lines of sight beyond the limb",
    )


@frozen
class EarthConfig:
    """What a scene may set of the background `earth`."""

    climate: str = text(
        default="us1976",
        choices=CLIMATES,
        help=SEASONS,
        source=LOWTRAN,
    )
    sky: str = text(
        default="clear",
        choices=("clear", "std_cirrus", "cumulus_top2.7km", "altostratus_top3.0km"),
        help="sky where the atmosphere has no opaque deck; the ground's albedo is 0.1",
        source=LOWTRAN,
        subject="sky",
    )
    cloud_albedo: float = number(
        default=0.3,
        minimum=0.0,
        maximum=1.0,
        help="albedo of the atmosphere's opaque cloud",
        source="the upper of the two in LOWTRAN's table here",
        subject="cloud",
    )
    sea_wind_m_s: float | None = number(
        default=None,
        unit="m/s",
        minimum=0.0,
        maximum=30.0,
        help="wind over a sea that covers the whole Earth and mirrors the Sun (sky: clear alone);"
        " for its structure set structure.surface",
        source="none: no sun glint",
        subject="sky",
    )
    clutter_residual: float = number(
        default=5e-6,
        minimum=0.0,
        maximum=1.0,
        help="standard deviation of what is left of the background after its subtraction, as a"
        " share of its radiance, for sensors without a focal plane",
        source="notional: leaves in long waves, in the sensors' default footprints, about the noise"
        " of a look",
        subject="residual",
    )
    bands: Mapping[str, str] = nested(
        default=Factory(dict),
        check=_stand_ins_complaint,
        help="by the name of a sensor's band the table's band that stands for it; radiance counts"
        " by width",
        source="no default: bands are found by their edges",
    )
    structure: StructuresConfig = nested(
        default=StructuresConfig(),
        help="structure of radiance, for sensors with a focal plane",
        subject="structure",
    )

    def __attrs_post_init__(self) -> None:
        if self.sea_wind_m_s is not None and self.sky != "clear":
            raise ValueError(
                f"sea_wind_m_s goes with sky: clear alone, not with {self.sky}; leave one of them"
                f" out"
            )
