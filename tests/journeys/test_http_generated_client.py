"""A Python client that openapi-python-client generates from the OpenAPI document, against a
service.
"""

import json
import subprocess
import sys

import openapi_python_client
import pytest
from http_service import LAUNCH, serving
from opir_http.routes import document
from waiting import until

pytestmark = pytest.mark.slow


def test_a_generated_client_launches_and_reads(tmp_path, monkeypatch):
    (tmp_path / "openapi.json").write_text(json.dumps(document()), encoding="utf-8")
    words = ["generate", "--path", "openapi.json", "--meta", "none", "--output-path", "opir_client"]
    command = [sys.executable, "-m", openapi_python_client.__name__, *words]
    run = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=120.0
    )
    assert "Unable to" not in run.stdout + run.stderr
    monkeypatch.syspath_prepend(str(tmp_path))
    from opir_client import Client
    from opir_client.api.default import detections, ready, status, tracks, trigger
    from opir_client.models import TracksTrail, Trigger

    with (
        serving(tmp_path, "--speed", "20") as stand,
        Client(base_url=f"http://127.0.0.1:{stand.port}") as client,
    ):
        until(lambda: ready.sync(client=client).ready)
        launched = trigger.sync(client=client, body=Trigger.from_dict(LAUNCH))
        assert launched.id.startswith("live-")
        until(lambda: detections.sync(client=client, limit=5).detections)
        result = status.sync(client=client)
        assert result.counts.targets_launched == 2
        assert result.health.alive
        assert result.sinks[0].attempts == 0
        assert isinstance(tracks.sync(client=client, trail=TracksTrail.TRUE).tracks, list)
