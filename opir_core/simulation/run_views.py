"""Views of a run: as HTML for notebooks, and those that plugins offer."""

from collections.abc import Mapping
from typing import Any

from opir_core.host.boundary import blamed_call, check_hint
from opir_core.host.components import RunView
from opir_core.host.host import Host
from opir_core.notebook import html_view

_HEAD = ("target", "type", "first detected by", "latency s", "detections", "reported")


def run_view(run: Any, name: str, wanted: str) -> Any:
    """Return a view of an `opir_core.Run`; `wanted` is for the message.

    Raises `PluginError` if no plugin offers it, `ModelError` if it fails.
    """
    host = _host_of(run, name)
    component = host.component(RunView, name, wanted)
    owner = f"{wanted}: the {component.kind} {name!r} of {host.provenance(RunView, name)}"
    return blamed_call(lambda: owner, check_hint(name), "build", lambda: component.build(run))


def _host_of(run: Any, name: str) -> Host:
    """Return the host of the run's plan, or one of what is installed if that host has no view of
    the name.

    A host of given plugins (`Host.of`) limits what a scene may name, not how its run is shown; an
    allow-list does both.
    """
    host: Host = run.plan.host
    return host if name in host.names(RunView) or host.registry.selection.rule else Host.discover()


def run_html(run: Any) -> str:
    """Return the repr of an `opir_core.Run`, a table of its first targets and, if one is installed,
    its view `map`.
    """
    table = html_view(run, _HEAD, [_row(target) for target in run.summary["targets"]])
    picture = (
        run_view(run, "map", "the map of a run")
        if "map" in _host_of(run, "map").names(RunView)
        else ""
    )
    return f"<div>{table}{picture}</div>"


def _row(target: Mapping[str, Any]) -> tuple[str, ...]:
    latency_s = target["latency_s"]
    return (
        target["target_id"],
        target["target_type"],
        target["first_sensor_id"] or "not detected",
        "" if latency_s is None else f"{latency_s:.3f}",
        str(target["detections"]),
        target["reported_type"] or "",
    )
