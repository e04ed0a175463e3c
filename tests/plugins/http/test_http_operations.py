"""The files of `examples/operations` fit the service: flags, exit codes, routes and metrics
exist.
"""

import argparse
import configparser
import json
import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import yaml
from http_service import serving
from opir_http.arguments import add_arguments
from opir_http.serving import STUCK
from repository import ROOT

from opir_core.cli.main import EXIT_CODES

FOLDER = ROOT / "examples" / "operations"
METRIC = re.compile(r"\bopir_[a-z_]+\b")


def served(words: list[str]) -> argparse.Namespace:
    """Return the arguments of `opir serve`, or fail where a flag does not exist."""
    parser = argparse.ArgumentParser(exit_on_error=False)
    add_arguments(parser)
    return parser.parse_args(words)


def rules() -> list[dict[str, Any]]:
    groups = yaml.safe_load((FOLDER / "alerts.yaml").read_text(encoding="utf-8"))["groups"]
    return [rule for group in groups for rule in group["rules"]]


def test_the_unit_starts_a_service_that_notifies_in_time() -> None:
    unit = configparser.ConfigParser(interpolation=None, strict=False)
    unit.optionxform = str  # type: ignore[assignment, method-assign]
    unit.read(FOLDER / "opir.service")
    service = unit["Service"]
    _program, command, *words = shlex.split(service["ExecStart"])
    arguments = served(words)
    assert (command, service["Type"], service["NotifyAccess"]) == ("serve", "notify", "main")
    assert arguments.supervise
    assert arguments.unready_after < arguments.dead_after < float(service["WatchdogSec"])
    assert service["RestartPreventExitStatus"].split() == ["2", "3"]
    meanings = dict(re.findall(r"^ +(\d+) +(.+)$", EXIT_CODES, flags=re.MULTILINE))
    assert "scene" in meanings["2"]
    assert "component" in meanings["3"]
    assert str(STUCK) not in service["RestartPreventExitStatus"].split()


def test_the_container_serves_and_asks_for_readiness() -> None:
    text = (FOLDER / "Containerfile").read_text(encoding="utf-8").replace("\\\n", " ")
    instructions = dict(
        line.split(maxsplit=1) for line in text.splitlines() if line and not line.startswith("#")
    )
    assert json.loads(instructions["ENTRYPOINT"]) == ["opir", "serve"]
    arguments = served(json.loads(instructions["CMD"]))
    assert (arguments.supervise, arguments.port, arguments.host) == (True, 8000, "0.0.0.0")
    code = json.loads(instructions["HEALTHCHECK"].partition(" CMD ")[2])[-1]
    compile(code, "HEALTHCHECK", "exec")
    assert f"http://127.0.0.1:{arguments.port}/health/ready" in code
    packages = re.findall(r"/src/(\S+)", instructions["RUN"])
    assert packages
    assert all((ROOT / package / "pyproject.toml").is_file() for package in packages)


def test_alerts_name_metrics_and_watch_queues_and_heartbeats(
    tmp_path: Path,
) -> None:
    with serving(tmp_path) as stand:
        page = stand.ask("GET", "/metrics").body.decode()
    kinds = dict(re.findall(r"^# TYPE (\S+) (\S+)$", page, flags=re.MULTILINE))
    metrics = {*kinds, *(f"{name}_bucket" for name, kind in kinds.items() if kind == "histogram")}
    names = {name for rule in rules() for name in METRIC.findall(rule["expr"])}
    assert names <= metrics
    watched = {"opir_ready", "opir_stuck", "opir_up", "opir_stream_up", "opir_cycle_age_seconds"}
    watched |= {
        f"opir_sink_{name}"
        for name in ("busy_seconds", "parked", "up", "queued_windows", "spooled")
    }
    assert watched | {"opir_sink_events_dropped_total", "opir_sink_unbalanced"} <= names


def test_rules_are_whole() -> None:
    names = [rule["alert"] for rule in rules()]
    assert len(set(names)) == len(names) >= 15
    for rule in rules():
        assert rule.keys() <= {"alert", "expr", "for", "labels", "annotations"}
        assert rule["labels"]["severity"] in {"info", "warning", "critical"}
        assert rule["annotations"]["summary"]
        assert rule["expr"].count("(") == rule["expr"].count(")")
        assert re.fullmatch(r"\d+[smh]", rule.get("for", "1m"))


@pytest.mark.parametrize("name", ["opir.service", "Containerfile", "alerts.yaml"])
def test_the_page_on_supervision_names_each_file(name: str) -> None:
    assert f"examples/operations/{name}" in (ROOT / "docs/how-to/supervise.md").read_text(
        encoding="utf-8"
    )
