"""`--log-format json`: every line that the service writes is one JSON object."""

import json
import subprocess
import sys
from typing import Any

import pytest
from opir_http.log import RequestLog

PROGRAM = """
import logging, sys, threading
from opir_http.json_log import log_as_json
log_as_json()
sys.setswitchinterval(1e-6)
print("opir: http://127.0.0.1:1")
logging.getLogger("opir").warning("two\\nlines %s", "\\u2028 and \\x1b")
try:
    1 / 0
except ZeroDivisionError:
    logging.getLogger("other").exception("it failed")
sys.stderr.write("opir: stuck")
sys.stderr.write("; ends\\nnext\\n")
threads = [threading.Thread(target=lambda: [print("x" * 50) for _ in range(200)]) for _ in range(4)]
[each.start() for each in threads], [each.join() for each in threads]
sys.stdout.fileno()
"""


def test_all_output_is_json_on_standard_error() -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True, timeout=60
    )
    assert not done.stdout
    rows = [json.loads(line) for line in done.stderr.splitlines()]
    assert all(row.keys() >= {"time", "level", "logger", "message"} for row in rows)
    assert [(row["level"], row["message"]) for row in rows[:5]] == [
        ("info", "http://127.0.0.1:1"),
        ("warning", "two\nlines \u2028 and \x1b"),
        ("error", "it failed"),
        ("error", "stuck; ends"),
        ("error", "next"),
    ]
    assert "ZeroDivisionError" in rows[2]["traceback"]
    assert [row["message"] for row in rows[5:]] == ["x" * 50] * 800


def answered(log: RequestLog, method: str, status: int, headers: Any = ()) -> None:
    scope = {"client": ("192.0.2.1", 1), "method": method, "path": '/co"nfig', "headers": headers}
    log._answered(scope, status, {b"ETag": b'"b"'})


@pytest.mark.parametrize("is_json", [False, True])
def test_requests_are_logged_with_their_fields(is_json: bool) -> None:
    lines: list[str] = []
    log = RequestLog(lines.append, "file", is_json=is_json)
    answered(log, "PUT", 200, [(b"if-match", b'"a"')])
    answered(log, "GET", 404)
    assert len(lines) == 2
    if not is_json:
        assert lines[0].startswith("opir: write: 192.0.2.1, token file: PUT ")
        return
    write, refused = map(json.loads, lines)
    assert (write["level"], write["client"], write["path"], write["status"]) == (
        "info",
        "192.0.2.1",
        '/co"nfig',
        200,
    )
    assert (write["token"], write["etag_before"], write["etag_after"]) == ("file", '"a"', '"b"')
    assert (refused["level"], refused["refused"]) == ("warning", 1)
