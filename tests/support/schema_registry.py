"""Schema registries for tests: Apicurio Registry itself, in memory, and a double that answers as
told.

Apicurio needs Java 17 and Maven; `why_absent` says what is missing.
"""

import fcntl
import hashlib
import json
import os
import shutil
import socket
import subprocess
import threading
from contextlib import contextmanager
from functools import cache
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import httpx
from waiting import until

POM = Path(__file__).parent / "registry" / "pom.xml"
_MEMORY = ("-Xmx320m", "-XX:+UseSerialGC", "-XX:TieredStopAtLevel=1")


@cache
def why_absent():
    """Return why there is no Apicurio Registry on this machine, or ""."""
    missing = [name for name in ("java", "mvn") if shutil.which(name) is None]
    if missing:
        return f"Apicurio Registry is left out: there is no {' and no '.join(missing)}"
    try:
        _program()
    except (OSError, subprocess.SubprocessError) as error:
        return f"Apicurio Registry is left out: Maven does not get it ({error})"
    return ""


@cache
def _program():
    """Return the program; Maven fetches and unpacks it once, for one process at a time."""
    mark = hashlib.sha256(POM.read_bytes()).hexdigest()[:16]
    cache_folder = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "opir-tests"
    cache_folder.mkdir(parents=True, exist_ok=True)
    folder = cache_folder / f"registry-{mark}"
    with (cache_folder / "registry.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not folder.is_dir():
            temporary = folder.with_suffix(f".{os.getpid()}")
            words = ["mvn", "-B", "-q", "-f", str(POM), "dependency:unpack"]
            words.append(f"-DoutputDirectory={temporary}")
            subprocess.run(
                words, check=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=300
            )
            temporary.rename(folder)
    return next(folder.glob("*-runner.jar"))


@contextmanager
def apicurio(folder):
    """Run Apicurio Registry in memory; yield the address of its Confluent interface."""
    with socket.socket() as bound:
        bound.bind(("127.0.0.1", 0))
        port = bound.getsockname()[1]
    command = ["java", *_MEMORY, "-Dquarkus.http.host=127.0.0.1", f"-Dquarkus.http.port={port}"]
    address = f"http://127.0.0.1:{port}/apis/ccompat/v7"
    with (folder / "log.txt").open("wb") as log:
        process = subprocess.Popen(
            [*command, "-jar", str(_program())], stdout=log, stderr=subprocess.STDOUT
        )
    try:
        until(lambda: _answers(address), within_s=120.0)
        yield address
    finally:
        process.kill()
        process.wait(30.0)


def _answers(address):
    try:
        return httpx.get(f"{address}/subjects", timeout=2.0).status_code == 200
    except httpx.HTTPError:
        return False


class Double:
    """A registry that gives the answers of a list, the last one for ever; `requests` are what it
    was sent: path, login and document.
    """

    def __init__(self):
        self.answers = [(200, {"id": 7})]
        self.requests = []
        double = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self):
                content = self.rfile.read(int(self.headers["Content-Length"]))
                login = self.headers.get("Authorization")
                double.requests.append((self.path, login, json.loads(content)))
                code, document = double.answers[0]
                double.answers = double.answers[1:] or double.answers
                body = document if isinstance(document, bytes) else json.dumps(document).encode()
                self.send_response(code)
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, *_words):
                """Print nothing."""

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.address = f"http://127.0.0.1:{self._server.server_port}"
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    def close(self):
        """Answer no more."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()
