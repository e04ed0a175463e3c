"""What the service refuses, and how: parameters, bodies, files of the machine, forms, methods,
names.
"""

import json
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Any

import pytest
from http_service import LAUNCH, SCENE, RunningService, conforms, serving
from opir_http.routes import document


@pytest.mark.parametrize(
    ("path", "word"),
    [
        ("/detections?limit=0", "limit"),
        ("/detections?limit=1001", "limit"),
        ("/detections?limit=1&limit=2", "duplicate"),
        ("/detections?min_confidence=nan", "min_confidence"),
        ("/detections?since=yesterday", "since"),
        ("/detections?after=%FF", "read"),
        ("/detections?after=../..", "after"),
        ("/detections?nothing=1", "unknown"),
        ("/status?x=1", "unknown"),
        ("/stream?view=all", "view"),
    ],
)
def test_a_parameter_that_is_wrong_is_named(stand: RunningService, path: str, word: str) -> None:
    answer = stand.ask("GET", path)
    assert (answer.status, answer.headers["content-type"]) == (400, "application/problem+json")
    assert word in answer.json["detail"]


BAD_BODIES = {
    "empty": (b"", 400),
    "not JSON": (b"{", 400),
    "a list": (b"[]", 422),
    "NaN": (b'{"type": NaN}', 400),
    "beyond a float": (
        b'{"type":"ICBM","launch":{"lat_deg":1e400,"lon_deg":0},"aim":{"lat_deg":0,"lon_deg":1}}',
        422,
    ),
    "huge whole number": (b'{"type":"ICBM","launch":{"lat_deg":' + b"9" * 5000 + b"}}", 400),
    "deep": (b'{"a":' * 9000 + b"1" + b"}" * 9000, 400),
    "deep, as far as it is read": (b'{"a":' * 500 + b"1" + b"}" * 500, 422),
    "deeper by one": (b'{"a":' * 501 + b"1" + b"}" * 501, 400),
    "deep list": (b"[" * 60000, 400),
    "key twice": (b'{"type":"ICBM","type":"SRBM"}', 400),
    "not UTF-8": (b'{"type":"\xff"}', 400),
    "UTF-16": ('{"type":"ICBM"}'.encode("utf-16"), 400),
    "half a surrogate pair": (b'{"type":"\\ud800"}', 422),
    "zero byte": (b'{"id":"\\u0000"}', 422),
    "wrong types": (b'{"type":1,"launch":"here","aim":[]}', 422),
    "too large": (b'{"type":"' + b"x" * 70000 + b'"}', 413),
    "unknown model": (json.dumps(LAUNCH | {"model": "warp"}).encode(), 422),
    "unknown key": (json.dumps(LAUNCH | {"secret": 1}).encode(), 422),
}


@pytest.mark.parametrize(("body", "status"), BAD_BODIES.values(), ids=BAD_BODIES)
def test_a_body_that_is_wrong_is_refused_and_changes_nothing(
    stand: RunningService, body: bytes, status: int
) -> None:
    for method, path in (("POST", "/trigger"), ("PUT", "/config")):
        answer = stand.ask(method, path, body, {"If-Match": "*"})
        assert answer.status == status, answer.body
        conforms(answer.json, "Problem")
        assert "Traceback" not in answer.body.decode()
        assert "/work" not in answer.body.decode()
        assert ".py" not in answer.body.decode()


SECRETS = {
    "a table": {"model": "table", "type": "ICBM", "file": "/etc/passwd"},
    "a table that never ends": {"model": "table", "type": "ICBM", "file": "/dev/zero"},
    "a signature": LAUNCH | {"signature": [{"table": {"path": "/etc/passwd"}}]},
    "very deep": LAUNCH | {"signature": json.loads('{"a":' * 300 + '{"file": "x"}' + "}" * 300)},
}


@pytest.mark.parametrize("body", SECRETS.values(), ids=SECRETS)
def test_no_launch_has_a_file_of_the_machine_read(stand: RunningService, body: Any) -> None:
    answer = stand.ask("POST", "/trigger", body)
    assert answer.status == 422
    assert b"root:" not in answer.body
    assert answer.json["errors"][0]["message"] == "only a scene may name files and variables"


OUTPUT = """
  - jsonl: {path: PATH, spool: {path: SPOOL}}
  - kafka:
      bootstrap_servers: "127.0.0.1:1"
      topic: t
      security: {protocol: SASL_PLAINTEXT, username: me, password_variable: OPIR_TEST_PASSWORD}
"""


def test_no_configuration_names_another_file_or_secret(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OPIR_TEST_PASSWORD", "the-word-itself")
    outputs = OUTPUT.replace("PATH", str(tmp_path / "a.jsonl")).replace(
        "SPOOL", str(tmp_path / "spool")
    )
    with serving(
        tmp_path, scene=SCENE.replace('outputs: ["null"]', f"outputs:{outputs}")
    ) as running:
        config = running.ask("GET", "/config")
        assert b"the-word-itself" not in config.body + running.ask("GET", "/status").body
        for place, keys, value in (
            ("outputs[0].jsonl.path", (0, "jsonl", "path"), str(tmp_path / "evil")),
            ("outputs[0].jsonl.spool.path", (0, "jsonl", "spool", "path"), "evil"),
            ("outputs[1]", (1, "kafka", "bootstrap_servers"), "evil.example:9092"),
            (
                "outputs[1].kafka.security.password_variable",
                (1, "kafka", "security", "password_variable"),
                "HOME",
            ),
        ):
            changed = config.json
            *path, key = keys
            reduce(getitem, path, changed["outputs"])[key] = value
            answer = running.ask("PUT", "/config", changed, {"If-Match": "*"})
            assert answer.status == 409
            assert place in [error["path"] for error in answer.json["errors"]]
        assert running.ask("PUT", "/config", config.json, {"If-Match": "*"}).status == 200
        assert not list(tmp_path.glob("evil*"))


def test_a_launch_that_is_past_is_reported_the_clock(stand: RunningService) -> None:
    answer = stand.ask("POST", "/trigger", LAUNCH | {"launch": LAUNCH["launch"] | {"time_s": 0.0}})
    assert (answer.status, "scene time is" in answer.json["detail"]) == (409, True)


FORM = "application/x-www-form-urlencoded"


@pytest.mark.parametrize(
    "kind", ["text/plain", f"{FORM}; charset=utf-8", "application/json; charset=latin-1", ""]
)
def test_other_content_types_are_refused(stand: RunningService, kind: str) -> None:
    assert (
        stand.ask("POST", "/trigger", json.dumps(LAUNCH).encode(), {"Content-Type": kind}).status
        == 415
    )


def test_what_curl_posts_by_default_is_read_as_json(stand: RunningService) -> None:
    assert (
        stand.ask("POST", "/trigger", json.dumps(LAUNCH).encode(), {"Content-Type": FORM}).status
        == 202
    )
    assert stand.ask("POST", "/trigger", b"type=ICBM", {"Content-Type": FORM}).status == 400


@pytest.mark.parametrize(
    ("method", "path"),
    [("DELETE", "/config"), ("POST", "/status"), ("PATCH", "/status"), ("PUT", "/trigger")],
)
def test_other_methods_are_refused(stand: RunningService, method: str, path: str) -> None:
    answer = stand.ask(method, path, b"{}")
    assert answer.status == 405
    assert answer.headers["allow"]


def test_no_other_origin_reads_an_answer(stand: RunningService) -> None:
    answer = stand.ask("GET", "/status", headers={"Origin": "https://elsewhere.example"})
    assert not [name for name in answer.headers if name.startswith("access-control")]


#: What the OWASP cheat sheet of HTTP headers asks of a page that nobody frames and that uses no
#: device.
SECURITY_HEADERS = {
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "permissions-policy": "camera=(), geolocation=(), microphone=()",
}


@pytest.mark.parametrize(
    ("method", "path"),
    [("GET", "/status"), ("GET", "/"), ("GET", "/missing"), ("DELETE", "/config"), ("HEAD", "/")],
)
def test_every_answer_has_the_security_headers(
    stand: RunningService, method: str, path: str
) -> None:
    answer = stand.ask(method, path)
    assert SECURITY_HEADERS.items() <= dict(answer.headers).items()
    for words in ("default-src 'none'", "frame-ancestors 'none'"):
        assert words in answer.headers["content-security-policy"]


def test_options_name_the_methods_of_each_path(stand: RunningService) -> None:
    for path, item in document()["paths"].items():
        answer = stand.ask("OPTIONS", path)
        assert answer.status == 204
        expected = {*item, "options"} | ({"head"} if "get" in item else set())
        assert {word.strip().lower() for word in answer.headers["allow"].split(",")} == expected
