"""What a scene may set of plumes. Nothing heavy is imported here."""

from collections.abc import Mapping
from typing import Any

from attrs import Factory, frozen

from opir_core.fields import nested, number, text

_TABLE = "opir_core/data/plumes.json; notional"
_TABLE_BANDS = ("SWIR", "MWIR", "LWIR")


def _peaks_complaint(peaks: Mapping[str, Any]) -> str | None:
    strange = [name for name in peaks if name not in _TABLE_BANDS]
    return f"{strange[0]!r} is not one of the bands {', '.join(_TABLE_BANDS)}" if strange else None


@frozen(kw_only=True)
class PlumeConfig:
    """What a scene may set of the signature model `plume`.

    The intensities are fixed in three bands, SWIR 2.5-3.0, MWIR 4.2-4.45 and LWIR 8-12 µm, and a spectrum through them
    gives those of other bands: a grey continuum of `continuum_temperature_k` that has all of LWIR, and the gases' bands
    near 2.7 and 4.3 µm at `gas_temperature_k`, which have what the continuum leaves of SWIR and MWIR.
    """

    profile: str | None = text(
        default=None,
        help="class of plume: SRBM, MRBM, IRBM, ICBM_solid or ICBM_liquid; by default the class profile that the target"
        " flies, or the first of its type",
        source="no default: the target's",
    )
    scale: float = number(
        default=1.0, minimum=0.0, maximum=1e6, help="factor on all intensities", source="the table's own"
    )
    peak_w_sr: Mapping[str, float] = nested(
        default=Factory(dict),
        unit="W/sr",
        minimum=0.0,
        maximum=1e12,
        check=_peaks_complaint,
        help="by SWIR, MWIR, LWIR the intensity of the first stage, seen broadside, at the best altitude; what is not"
        " given is the class's",
        source=_TABLE,
    )
    stages: int | None = number(
        default=None,
        minimum=1,
        maximum=8,
        help="stages, of equal shares of the burn; by default the class's",
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
        default=(0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 90.0, 100.0, 120.0, 150.0, 200.0, 300.0),
        unit="km",
        minimum=-1.0,
        maximum=100_000.0,
        help="rising altitudes at which altitude_scale stands; straight between, constant beyond the ends",
        source=_TABLE,
    )
    altitude_scale: tuple[float, ...] = nested(
        default=(0.6, 0.8, 1.0, 1.0, 0.9, 0.7, 0.45, 0.28, 0.2, 0.22, 0.27, 0.33, 0.33, 0.3, 0.25),
        minimum=0.0,
        maximum=1e3,
        help="intensity over its best: afterburning low down, a trough at 70 to 90 km, recovery in vacuum",
        source=_TABLE,
    )
    nose_on: float = number(
        default=0.1, minimum=0.0, maximum=1.0, help="intensity seen from straight ahead over that seen broadside"
    )
    tail_on: float = number(
        default=0.3, minimum=0.0, maximum=1.0, help="intensity seen from straight behind over that seen broadside"
    )
    body_temperature_k: float = number(
        default=300.0,
        unit="K",
        minimum=100.0,
        maximum=6000.0,
        help="temperature of the body after burnout, for sensors that follow bodies",
    )
    body_area_m2: float = number(
        default=4.0,
        unit="m2",
        minimum=0.0,
        maximum=1e4,
        help="area that the body shows after burnout, projected, the mean over aspects",
    )
    body_emissivity: float = number(default=0.9, minimum=0.0, maximum=1.0, help="emissivity of the body after burnout")
    continuum_temperature_k: float = number(
        default=1500.0, unit="K", minimum=300.0, maximum=6000.0, help="temperature of the grey continuum, of particles"
    )
    gas_temperature_k: float = number(
        default=2000.0, unit="K", minimum=300.0, maximum=6000.0, help="temperature of the gases in their bands"
    )

    def __attrs_post_init__(self) -> None:
        if len(self.altitude_km) != len(self.altitude_scale) or not self.altitude_km:
            raise ValueError("altitude_km and altitude_scale are not lists of one length")
        if any(high <= low for low, high in zip(self.altitude_km, self.altitude_km[1:], strict=False)):
            raise ValueError("altitude_km: each is to be above the one before it")
