"""What a scene may set of targets from files. Nothing heavy is imported here."""

from collections.abc import Mapping
from typing import Any

from attrs import Factory, frozen

from opir_core.plugin import TargetClass, nested, number, text
from opir_readers.columns import map_complaint


def _scene_time(meaning: str, default: float | None = None) -> Any:
    """Return the field of a time of the scene, s."""
    return number(default=default, unit="s", minimum=0.0, maximum=31_557_600.0, help=meaning)


@frozen(kw_only=True)
class TableConfig:
    """What a scene may set of a target of the model `table`."""

    type: str = text(
        names_of=TargetClass.hook, help="target class: ICBM, IRBM, SRBM, MRBM, SLBM, HGV, SLV, or that of a plugin"
    )
    file: str = text(
        help="path of a table of states: text with the columns time_s, x_ecef_m, y_ecef_m, z_ecef_m (and vx_ecef_m_s,"
        " vy_ecef_m_s, vz_ecef_m_s, is_burning: 1 where the plume radiates up to the next line's time, else 0) or with"
        " those of columns, parted by commas, semicolons, tabs or blanks; or a CCSDS OEM (KVN) in UTC and ITRF, TDR,"
        " GRC, TEME or EME2000"
    )
    columns: Mapping[str, str] = nested(
        default=Factory(dict),
        check=map_complaint,
        help="columns of a text with other names, by quantity and unit: {time_s: T, lat: Latitude, lon: Longitude,"
        " height_ft: ALT}. Times in s, ms, min, h; lengths in m, km, ft, nmi; speeds in m_s, km_s, ft_s, km_h, kn;"
        " velocities as vx_ecef, vy_ecef, vz_ecef, vx_inertial, vy_inertial, vz_inertial, or v_east, v_north, v_up",
    )
    start_s: float | None = number(
        default=None,
        unit="s",
        minimum=-1e13,
        maximum=31_557_600.0,
        help="scene time of time 0 of a CSV file; default 0",
    )
    object: str | None = text(default=None, help="OBJECT_NAME or OBJECT_ID, for an OEM with several objects")
    ignition_s: float | None = _scene_time("scene time of the first ignition; default: from the file")
    burnout_s: float | None = _scene_time("scene time at which the last burn ends; default: from the file")
