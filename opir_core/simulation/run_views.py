"""Views of a run: as HTML for notebooks, and what other packages of this project add, imported when it is asked for."""

from collections.abc import Mapping
from html import escape
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from opir_core.errors import PluginError
from opir_core.host.error_messages import way_to_install

#: Rows of the table.
_LISTED = 12

_HEAD = ("target", "type", "first detected by", "latency s", "detections", "reported")


def provided(package: str, name: str, wanted: str) -> Any:
    """Return a name of another package of this project; `PluginError` with the remedy if it is not installed.

    `wanted` is what the user asked for, for the message.
    """
    try:
        module = import_module(package)
    except ModuleNotFoundError as error:
        if error.name != package:
            words = f"{wanted} needs {error.name}, which is not installed: python -m pip install {error.name}"
            raise PluginError(words) from error
        raise PluginError(f"{wanted} is not available\n  {way_to_install(package.replace('_', '-'))}") from error
    return getattr(module, name)


def run_html(run: Any) -> str:
    """Return the repr of an `opir_core.Run`, a table of its first targets and, with opir-report, its map."""
    targets = run.summary["targets"]
    head = "".join(f"<th>{name}</th>" for name in _HEAD)
    rows = "".join(f"<tr>{_row(target)}</tr>" for target in targets[:_LISTED])
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>" if targets else ""
    more = f"<p>and {len(targets) - _LISTED} more targets</p>" if len(targets) > _LISTED else ""
    picture = provided("opir_report", "map_svg", "the map of a run")(run) if find_spec("opir_report") else ""
    return f"<div><p>{escape(repr(run).strip('<>'))}</p>{table}{more}{picture}</div>"


def _row(target: Mapping[str, Any]) -> str:
    latency_s = target["latency_s"]
    cells = (
        target["target_id"],
        target["target_type"],
        target["first_sensor_id"] or "not detected",
        "" if latency_s is None else f"{latency_s:.3f}",
        str(target["detections"]),
        target["reported_type"] or "",
    )
    return "".join(f"<td>{escape(cell)}</td>" for cell in cells)
