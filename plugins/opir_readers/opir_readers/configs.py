"""What a scene may set of targets from files. Nothing heavy is imported here."""

from collections.abc import Mapping
from typing import Any

from attrs import frozen

from opir_core.plugin import FileReader, TargetClass, flag, nested, number, text
from opir_readers.configs_of_sites import (
    SITE_HELP,
    SiteConfig,
    burns_setting,
    noise_setting,
    start_setting,
)
from opir_readers.formats import OBJECT_HELP, columns_setting


def _scene_time(meaning: str, default: float | None = None) -> Any:
    """Return the field of a time of the scene, s."""
    return number(default=default, unit="s", minimum=0.0, maximum=31_557_600.0, help=meaning)


@frozen
class TableConfig:
    """What a scene may set of a target of the model `table`."""

    type: str = text(
        names_of=TargetClass.hook,
        help="target class: ICBM, IRBM, SRBM, MRBM, SLBM, HGV, SLV, or that of a plugin",
    )
    file: str = text(
        help="path of a table of states: text with the columns time_s, x_ecef_m, y_ecef_m, z_ecef_m"
        " (and vx_ecef_m_s, vy_ecef_m_s, vz_ecef_m_s, is_burning: 1 where the plume radiates up to"
        " the next line's time, else 0) or with those of columns, parted by commas, semicolons,"
        " tabs or blanks; or what another reader reads (opir plugins): CCSDS OEM, STK, SP3, GPX,"
        " KML, exports of rocket simulators, telemetry of webcasts"
    )
    format: str | None = text(
        default=None, names_of=FileReader.hook, help="reader of the file; default: by content"
    )
    columns: Mapping[str, str] = columns_setting()
    start_s: float | None = start_setting()
    site: SiteConfig | None = nested(default=None, help=SITE_HELP)
    object: str | None = text(default=None, help=OBJECT_HELP)
    noise_m: float | None = noise_setting()
    as_given: bool = flag(
        default=False,
        source="states that contradict gravity were read wrongly",
        help="take the states as they are, though they contradict gravity",
    )
    burns: str | None = burns_setting()
    ignition_s: float | None = _scene_time(
        "scene time of the first ignition; default: from the file"
    )
    burnout_s: float | None = _scene_time(
        "scene time at which the last burn ends; default: from the file"
    )


_TO_ORBIT = ("with flight: orbit", lambda config: config.flight == "orbit")


@frozen
class AscentConfig:
    """What a scene may set of a target of the model `ascent`."""

    type: str = text(
        default="SLV", names_of=TargetClass.hook, source="space launches", help="target class"
    )
    flight: str = text(
        default="orbit",
        choices=("orbit", "booster"),
        help="orbit: two burns into a circular orbit; booster: the first burn, and those of a"
        " booster that lands",
    )
    lat_deg: float = number(
        unit="deg", minimum=-89.0, maximum=89.0, help="geodetic latitude of the launch (WGS 84)"
    )
    lon_deg: float = number(
        unit="deg", minimum=-180.0, maximum=180.0, help="east longitude of the launch"
    )
    height_m: float = number(
        default=0.0,
        unit="m",
        minimum=-500.0,
        maximum=9000.0,
        help="height of the launch above the ellipsoid",
    )
    time_s: float = number(
        default=0.0, unit="s", minimum=0.0, maximum=31_557_600.0, help="scene time of lift-off"
    )
    azimuth_deg: float = number(
        default=90.0,
        unit="deg",
        minimum=0.0,
        maximum=360.0,
        help="direction of flight over the Earth, from north",
    )
    first_burn_s: float = number(
        default=160.0,
        unit="s",
        minimum=120.0,
        maximum=200.0,
        help="first burn, of a launcher that weighs 1/1.3 of it",
    )
    gap_s: float = number(
        default=11.0,
        unit="s",
        minimum=2.0,
        maximum=60.0,
        help="dark time after the first burn",
        read_if=_TO_ORBIT,
    )
    second_burn_s: float = number(
        default=360.0,
        unit="s",
        minimum=250.0,
        maximum=600.0,
        help="second burn, to orbit",
        read_if=_TO_ORBIT,
    )
    orbit_altitude_km: float = number(
        default=200.0,
        unit="km",
        minimum=150.0,
        maximum=400.0,
        help="altitude of the orbit above the equatorial radius",
        read_if=_TO_ORBIT,
    )
    followed_s: float = number(
        default=1500.0,
        unit="s",
        minimum=60.0,
        maximum=86_400.0,
        help="how long it is followed in orbit, by sensors that follow bodies",
        read_if=_TO_ORBIT,
        subject="bodies",
    )
    flies_back: bool = flag(
        default=True,
        help="whether a booster lands at the launch site, not down the range",
        read_if=("with flight: booster", lambda config: config.flight == "booster"),
    )
