"""What a scene may set of targets from files. Nothing heavy is imported here."""

from collections.abc import Mapping
from typing import Any

from attrs import frozen

from opir_core.plugin import FileReader, TargetClass, nested, number, text
from opir_readers.configs_of_sites import SITE_HELP, SiteConfig, burns_setting, noise_setting, start_setting
from opir_readers.formats import OBJECT_HELP, columns_setting


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
        " those of columns, parted by commas, semicolons, tabs or blanks; or what another reader reads (opir plugins):"
        " CCSDS OEM, STK, SP3, GPX, KML, exports of rocket simulators, telemetry of webcasts"
    )
    format: str | None = text(default=None, names_of=FileReader.hook, help="reader of the file; default: by content")
    columns: Mapping[str, str] = columns_setting()
    start_s: float | None = start_setting()
    site: SiteConfig | None = nested(default=None, help=SITE_HELP)
    object: str | None = text(default=None, help=OBJECT_HELP)
    noise_m: float | None = noise_setting()
    burns: str | None = burns_setting()
    ignition_s: float | None = _scene_time("scene time of the first ignition; default: from the file")
    burnout_s: float | None = _scene_time("scene time at which the last burn ends; default: from the file")
