"""Who may knock: pages of other sites, wrong tokens, names that look like this machine, bodies of
two lengths.
"""

import socket
from pathlib import Path

import pytest
from http_service import LAUNCH, RunningService, serving

TOKEN = "correct-horse-battery"


@pytest.mark.parametrize(
    "host", ["[::1].evil.example", "[::1", "localhost.evil.example", "::1", "[::1]x:80", ""]
)
def test_a_name_that_only_looks_like_this_machine_is_refused(
    stand: RunningService, host: str
) -> None:
    assert stand.ask("GET", "/status", headers={"Host": host}).status == 421


@pytest.mark.parametrize(
    "host", ["localhost", "localhost:8000", "127.0.0.1:9", "[::1]", "[::1]:8000"]
)
def test_a_name_of_this_machine_is_served(stand: RunningService, host: str) -> None:
    assert stand.ask("GET", "/status", headers={"Host": host}).status == 200


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "https://evil.example"},
        {"Origin": "null"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site", "Origin": "http://localhost:1"},
    ],
)
@pytest.mark.parametrize(
    ("method", "path"), [("POST", "/outputs/x/retry"), ("POST", "/trigger"), ("PUT", "/config")]
)
def test_a_page_of_another_site_writes_nothing(
    stand: RunningService, method: str, path: str, headers: dict[str, str]
) -> None:
    answer = stand.ask(method, path, LAUNCH, {"If-Match": "*", **headers})
    assert answer.status == 403
    assert "other sites" in answer.json["detail"]


def test_the_own_page_writes(stand: RunningService) -> None:
    headers = {
        "Host": f"127.0.0.1:{stand.port}",
        "Origin": f"http://127.0.0.1:{stand.port}",
        "Sec-Fetch-Site": "same-origin",
    }
    assert stand.ask("POST", "/trigger", LAUNCH, headers).status == 202


def test_wrong_tokens_wait_and_the_right_one_does_not(tmp_path: Path) -> None:
    with serving(tmp_path, token=TOKEN) as running:
        wrong = {"Authorization": f"Bearer {TOKEN}x"}
        answers = [running.ask("GET", "/status", headers=wrong) for _ in range(40)]
        assert {answer.status for answer in answers} == {401, 429}
        refused = next(answer for answer in answers if answer.status == 429)
        assert int(refused.headers["retry-after"]) >= 1
        assert (
            running.ask("GET", "/status", headers={"Authorization": f"Bearer {TOKEN}"}).status
            == 200
        )
        assert running.ask("GET", "/status").status == 401


def test_a_body_with_two_lengths_closes_the_connection(stand: RunningService) -> None:
    head = b"POST /trigger HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    lengths = b"Content-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n2\r\n{}\r\n0\r\n\r\n"
    with socket.create_connection(("127.0.0.1", stand.port), timeout=20) as client:
        client.sendall(head + lengths + b"GET /status HTTP/1.1\r\nHost: localhost\r\n\r\n")
        text = b""
        while chunk := client.recv(65536):
            text += chunk
    assert text.startswith(b"HTTP/1.1 400")
    assert text.count(b"HTTP/1.1 ") == 1
