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

import jsonschema
import npm_packages
import pytest
import yaml
from http_service import serving
from opir_http.arguments import add_arguments
from opir_http.serving import STUCK
from repository import ROOT
from waiting import until

from opir_core import Host
from opir_core.cli import scene_of
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


@pytest.fixture(scope="module")
def metrics_page(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the metrics of a service that knows its sensors' calibration."""
    with serving(tmp_path_factory.mktemp("metrics"), "--speed", "20", "--tracker", "imm") as stand:
        until(lambda: b"opir_sensor_outlier_ratio{" in stand.ask("GET", "/metrics").body)
        return stand.ask("GET", "/metrics").body.decode()


@pytest.fixture(scope="module")
def metrics(metrics_page: str) -> set[str]:
    kinds = dict(re.findall(r"^# TYPE (\S+) (\S+)$", metrics_page, flags=re.MULTILINE))
    return {*kinds, *(f"{name}_bucket" for name, kind in kinds.items() if kind == "histogram")}


def test_alerts_name_metrics_and_watch_queues_and_heartbeats(metrics: set[str]) -> None:
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


def panels() -> list[dict[str, Any]]:
    """Return the panels of the board that show something."""
    board = json.loads((FOLDER / "grafana.json").read_text(encoding="utf-8"))
    return [panel for panel in board["panels"] if panel["type"] != "row"]


def test_every_query_of_the_board_names_a_metric_of_the_service(metrics: set[str]) -> None:
    queries = [target["expr"] for panel in panels() for target in panel["targets"]]
    assert len(queries) >= 30
    assert {name for query in queries for name in METRIC.findall(query)} <= metrics
    assert all(METRIC.search(query) for query in queries)
    assert all(query.count("(") == query.count(")") for query in queries)
    watched = {name for rule in rules() for name in METRIC.findall(rule["expr"])}
    shown = {name for query in queries for name in METRIC.findall(query)}
    assert watched <= shown, "an alert has a panel that shows why"


def test_every_name_in_a_legend_is_a_label_of_its_metric(metrics_page: str) -> None:
    labels = {
        name: set(re.findall(r'(\w+)="', found))
        for name, found in re.findall(r"^(\w+)\{(.*)\} ", metrics_page, flags=re.MULTILINE)
    }
    for panel in panels():
        for target in panel["targets"]:
            named = set(re.findall(r"\{\{(\w+)\}\}", target["legendFormat"])) - {"instance"}
            (metric,) = set(METRIC.findall(target["expr"])) if named else [""]
            assert named <= labels.get(metric, set()), panel["title"]


def test_panels_of_the_board_stand_side_by_side() -> None:
    board = json.loads((FOLDER / "grafana.json").read_text(encoding="utf-8"))
    places = [panel["gridPos"] for panel in board["panels"]]
    cells = [
        (column, line)
        for place in places
        for column in range(place["x"], place["x"] + place["w"])
        for line in range(place["y"], place["y"] + place["h"])
    ]
    assert len(set(cells)) == len(cells)
    assert max(column for column, _ in cells) == 23
    numbers = [panel["id"] for panel in board["panels"]]
    assert len(set(numbers)) == len(numbers)


def chain() -> dict[str, Any]:
    return yaml.safe_load((FOLDER / "compose.yaml").read_text(encoding="utf-8"))


def test_the_chain_starts_a_service_that_the_consumer_can_read(tmp_path: Path) -> None:
    services = chain()["services"]
    assert list(services) == ["kafka", "opir", "consumer"]
    service = services["opir"]
    arguments = served(service["command"])
    assert (arguments.supervise, arguments.host, arguments.port) == (True, "0.0.0.0", 8000)
    volumes = dict(volume.split(":")[:2] for volume in service["volumes"])
    scene_path = next(path for path, place in volumes.items() if place == arguments.scene)
    arguments.scene = str(FOLDER / scene_path)
    scene = scene_of(arguments, Host.discover())
    (output,) = scene.outputs
    advertised = services["kafka"]["environment"]["KAFKA_ADVERTISED_LISTENERS"]
    assert advertised == f"PLAINTEXT://{output.config.bootstrap_servers}"
    consumer = services["consumer"]["entrypoint"]
    assert f"--topic={output.config.topic}" in consumer
    assert f"--bootstrap-server={output.config.bootstrap_servers}" in consumer
    place = Path(output.spool.path).parent
    assert str(place) in volumes.values()
    assert f"VOLUME {place}\n" in (FOLDER / "Containerfile").read_text(encoding="utf-8")
    build = service["build"]
    assert (FOLDER / build["context"] / build["dockerfile"]).samefile(FOLDER / "Containerfile")


def test_the_chain_is_open_to_this_machine_only_and_needs_a_token() -> None:
    services = chain()["services"]
    ports = [port for service in services.values() for port in service.get("ports", ())]
    assert ports == ["127.0.0.1:8000:8000"]
    assert services["opir"]["environment"]["OPIR_HTTP_TOKEN"].startswith("${OPIR_HTTP_TOKEN:?")
    # A first part with a dot or a port would be the host of a registry.
    images = [service["image"] for service in services.values() if "image" in service]
    assert images
    assert not any(re.search(r"[.:]", image.partition("/")[0]) for image in images)


@pytest.mark.slow
@pytest.mark.parametrize("path", ["docker-compose.yml", "examples/operations/compose.yaml"])
def test_the_schema_of_compose_files_accepts(path: str) -> None:
    """The schema of the Compose specification, as a linter of npm ships it."""
    sources = ROOT / "tests" / "support" / "compose"
    folder = npm_packages.installed(sources, "the schema of Compose")
    text = (folder / "node_modules/dclint/schemas/compose.schema.json").read_text(encoding="utf-8")
    schema = jsonschema.Draft7Validator(json.loads(text))
    document = yaml.safe_load((ROOT / path).read_text(encoding="utf-8"))
    schema.validate(document)
    document["services"]["kafka"]["healthcheck"]["attempts"] = 3
    with pytest.raises(jsonschema.ValidationError, match="attempts"):
        schema.validate(document)


@pytest.mark.parametrize(
    "name", ["opir.service", "Containerfile", "alerts.yaml", "grafana.json", "compose.yaml"]
)
def test_the_page_on_supervision_names_each_file(name: str) -> None:
    assert f"examples/operations/{name}" in (ROOT / "docs/how-to/supervise.md").read_text(
        encoding="utf-8"
    )
