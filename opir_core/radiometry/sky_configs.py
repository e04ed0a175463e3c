"""What a scene may set of the sky: atmosphere, clouds and background. Nothing heavy is imported here."""

from collections.abc import Mapping
from typing import Any

from attrs import Factory, frozen

from opir_core.fields import nested, number, text

LOWTRAN = "LOWTRAN7 as shipped in opir_core/data"
CLIMATES = ("us1976", "tropical", "midlat_summer", "midlat_winter", "subarctic_winter")
TABLE_BANDS = ("SWIR", "SWIR_N", "MWIR", "MWIR_N", "LWIR", "STG_2.0_2.4", "MWIRW_3.5_4.0")


def _stand_ins_complaint(bands: Mapping[str, Any]) -> str | None:
    strange = [name for name in bands.values() if name not in TABLE_BANDS]
    return f"{strange[0]!r} is not one of {', '.join(TABLE_BANDS)}" if strange else None


@frozen(kw_only=True)
class CloudConfig:
    """A thin opaque deck of cloud that hides what is below its top."""

    top_km: float = number(default=10.0, unit="km", above=0.0, maximum=20.0, help="height of the top")
    cover: float = number(
        default=1.0,
        minimum=0.0,
        maximum=1.0,
        help="share of the Earth that is covered: cells are drawn independently, once a run",
    )
    cell_km: float = number(default=100.0, unit="km", minimum=10.0, maximum=5000.0, help="size of a cell")


@frozen(kw_only=True)
class LowtranConfig:
    """What a scene may set of the atmosphere `lowtran`."""

    climate: str = text(default="us1976", choices=CLIMATES, help="model atmosphere", source=LOWTRAN)
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
        help="by the name of a sensor's band the band of LOWTRAN's table that stands for it, where its edges are not in"
        " the table",
        source="no default: bands are found by their edges",
    )
    cloud: CloudConfig | None = nested(default=None, help="a deck of cloud", source="none: a clear sky")

    def __attrs_post_init__(self) -> None:
        if self.aerosol == "none" and self.climate != "us1976":
            raise ValueError(f"aerosol: none goes with the climate us1976 alone, not with {self.climate}; leave it out")


@frozen(kw_only=True)
class EarthConfig:
    """What a scene may set of the background `earth`."""

    climate: str = text(
        default="us1976",
        choices=("us1976", "tropical", "midlat_summer", "subarctic_winter"),
        help="model atmosphere",
        source=LOWTRAN,
    )
    sky: str = text(
        default="clear",
        choices=("clear", "std_cirrus", "cumulus_top2.7km", "altostratus_top3.0km"),
        help="sky where the atmosphere has no opaque deck; the ground's albedo is 0.1",
        source=LOWTRAN,
    )
    cloud_albedo: float = number(
        default=0.3,
        minimum=0.0,
        maximum=1.0,
        help="albedo of the atmosphere's opaque cloud",
        source="the upper of the two in LOWTRAN's table here",
    )
    clutter_residual: float = number(
        default=5e-6,
        minimum=0.0,
        maximum=1.0,
        help="standard deviation of what is left of the background after its subtraction, as a share of its radiance",
        source="notional: leaves in long waves, in the sensors' default footprints, about the noise of a look",
    )
    bands: Mapping[str, str] = nested(
        default=Factory(dict),
        check=_stand_ins_complaint,
        help="by the name of a sensor's band the table's band that stands for it; radiance counts by width",
        source="no default: bands are found by their edges",
    )
