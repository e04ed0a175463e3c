"""The service against its own OpenAPI: right and wrong requests made from the document, alone and one after another.

`/stream` is left out: its answer has no end, and is tested in `tests/plugins/test_http_service.py`. Every answer is
held against the document: statuses, content types, headers, bodies; wrong requests are refused; none is answered 5xx.
"""

import os
import subprocess
import sys
from pathlib import Path

from attrs import evolve
from http_stand import serving

#: How long the requests go on, s.
FOR_S = int(os.environ.get("OPIR_SCHEMATHESIS_S", "8"))

#: What a request may be answered that keeps to the schema: a document cannot say that a type's burn time fits its mass,
#: that a day is in its month, or which tag is in force.
SETTINGS = """
[checks]
positive_data_acceptance.expected-statuses = ["2xx", 400, 401, 403, 404, 409, 412, 422, 429]
"""


def test_the_service_keeps_to_its_document_whatever_it_is_asked(tmp_path: Path) -> None:
    with serving(tmp_path, "--speed", "5", "--loop", "--max-targets", "50") as running:
        running.service.settings = evolve(running.service.settings, writes_per_s=10_000.0)
        address = f"http://127.0.0.1:{running.port}"
        command = [sys.executable, "-m", "schemathesis.cli", "--config-file", "schemathesis.toml"]
        command += ["run", f"{address}/openapi.json", "--exclude-path", "/stream"]
        command += ["--mode", "all", "--checks", "all", "--phases", "examples,coverage,fuzzing,stateful"]
        (tmp_path / "schemathesis.toml").write_text(SETTINGS, encoding="utf-8")
        command += ["--max-time", str(FOR_S), "--max-examples", str(5 * FOR_S), "--seed", "5", "--no-color"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=FOR_S + 120, check=False)
        assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]
        assert running.ask("GET", "/health/live").status == 200
