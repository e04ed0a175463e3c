"""The service against its own OpenAPI: right and wrong requests made from the document, alone and
one after another.

`/stream` is left out: its answer has no end, and is tested in
`tests/plugins/http/test_http_service.py`. Every answer is held against the document: statuses,
content types, headers, bodies. Wrong requests are refused; none is answered 5xx.
OPIR_SCHEMATHESIS_S and OPIR_SCHEMATHESIS_SEED make it longer and another one.
"""

import os
import re
import subprocess
import sys

import pytest
from attrs import evolve
from http_service import serving
from opir_http.routes import document
from peer_libraries import missing

pytestmark = [
    pytest.mark.peers,
    pytest.mark.skipif(
        "schemathesis" in missing(), reason="schemathesis is not installed: pip install '.[peers]'"
    ),
]

#: How long the requests of each kind go on, s; by default the steps along links are bounded by
#: their number alone.
FOR_S = int(os.environ.get("OPIR_SCHEMATHESIS_S", "3"))
STEPS = ("--max-time", str(FOR_S)) if "OPIR_SCHEMATHESIS_S" in os.environ else ()
SCENARIOS = 5 * FOR_S if STEPS else 20
SEED = os.environ.get("OPIR_SCHEMATHESIS_SEED", "6")

#: What a request may be answered that keeps to the schema: a document cannot say that a type's burn
#: time fits its mass, that a day is in its month, or which tag is in force. A tag that is missing
#: or not in force is reported before the body is looked at (RFC 9110, 13.2.1; RFC 6585, 3).
SETTINGS = """
[checks]
positive_data_acceptance.expected-statuses = ["2xx", 400, 401, 403, 404, 409, 412, 422, 429]
negative_data_rejection.expected-statuses = [400, 404, 405, 409, 412, 413, 415, 422, 428, 429]
missing_required_header.expected-statuses = [400, 415, 422, 428]
"""


@pytest.fixture(scope="module")
def stand(tmp_path_factory):
    words = ("--speed", "5", "--loop", "--max-targets", "50")
    with serving(tmp_path_factory.mktemp("stand"), *words) as running:
        running.service.settings = evolve(running.service.settings, writes_per_s=10_000.0)
        yield running


def examined(stand, folder, phases, *words):
    """Let schemathesis ask; return what it says, which must be that nothing is wrong."""
    (folder / "schemathesis.toml").write_text(SETTINGS, encoding="utf-8")
    command = [sys.executable, "-m", "schemathesis.cli", "--config-file", "schemathesis.toml"]
    command += ["run", f"http://127.0.0.1:{stand.port}/openapi.json", "--exclude-path", "/stream"]
    command += [
        "--mode",
        "all",
        "--checks",
        "all",
        "--phases",
        phases,
        "--seed",
        SEED,
        "--no-color",
        *words,
    ]
    command += [
        "--request-timeout",
        "30",
    ]  # for machines with other work; deadlines are tested elsewhere
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=FOR_S + 180, check=False
    )
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]
    assert stand.ask("GET", "/health/live").status == 200
    return done.stdout


@pytest.mark.slow
def test_the_service_keeps_to_its_document_whatever_it_is_asked(stand, tmp_path):
    more = ("--max-time", str(FOR_S), "--max-examples", str(5 * FOR_S))
    examined(stand, tmp_path, "examples,coverage,fuzzing", *more)


@pytest.mark.slow
def test_the_service_keeps_to_its_document_along_the_links_of_its_answers(stand, tmp_path):
    reported = examined(stand, tmp_path, "stateful", *STEPS, "--max-examples", str(SCENARIOS))
    result = re.search(r"API Links: +(\d+) covered / (\d+) selected", reported)
    assert result, reported
    assert int(result[2]) >= links()
    assert int(result[1]) >= 3, reported


def links():
    """Return how many links the document has."""
    operations = [operation for item in document()["paths"].values() for operation in item.values()]
    return sum(
        len(answer.get("links", {}))
        for operation in operations
        for answer in operation["responses"].values()
    )
