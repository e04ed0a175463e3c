"""A service in this process, on a free port of the loopback, and requests to it."""

import argparse
import asyncio
import http.client
import json
import threading
from collections.abc import Mapping
from contextlib import contextmanager

import jsonschema
from attrs import define
from opir_http.arguments import add_arguments
from opir_http.routes import application, document
from opir_http.server import Server, bound
from opir_http.service import Service
from opir_http.serving import server_of, service_of
from waiting import within

JSON = {"Content-Type": "application/json"}

LAUNCH = {
    "type": "ICBM",
    "launch": {"lat_deg": 34.73, "lon_deg": -120.57},
    "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
}

SCENE = """
scene: stand
epoch: "2026-04-01T12:00:00Z"
duration_s: 600
seed: 5
sensors:
  - constellation: DSP
  - constellation: SBIRS-GEO
targets:
  - id: T1
    type: ICBM
    launch: {lat_deg: 34.73, lon_deg: -120.57, time_s: 1.0}
    aim: {lat_deg: 9.0, lon_deg: 167.7}
outputs: ["null"]
"""


@define
class Answer:
    """What came back."""

    status: int
    headers: Mapping[str, str]
    body: bytes

    @property
    def json(self):
        return json.loads(self.body)


@define
class RunningService:
    """A running service."""

    port: int
    service: Service
    server: Server

    def ask(
        self,
        method,
        path,
        body=None,
        headers=None,
        *,
        timeout_s=60,
    ):
        """Make one request; a body that is not bytes is sent as JSON. An answer that does not end
        in time fails.
        """
        raw = body if body is None or isinstance(body, bytes) else json.dumps(body).encode()
        inputs = {**(JSON if raw is not None else {}), **(headers or {})}
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=timeout_s)

        def answer():
            connection.request(method, path, raw, inputs)
            response = connection.getresponse()
            fields = {key.lower(): value for key, value in response.getheaders()}
            return Answer(response.status, fields, response.read())

        try:
            return within(timeout_s + 5.0, answer)
        finally:
            connection.close()


@contextmanager
def serving(
    folder,
    *words,
    scene=SCENE,
    token=None,
    host=None,
):
    """Serve a scene with further arguments of `opir serve`."""
    path = folder / "scene.yaml"
    path.write_text(scene, encoding="utf-8")
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    service = service_of(parser.parse_args([str(path), *words]), host)
    begun = threading.Event()
    servers = []

    async def run():
        servers.append(server_of(service, application(service), token))
        begun.set()
        await servers[0].serve(sockets=[listening])

    with bound("127.0.0.1", 0) as listening:
        service.run.start()
        thread = threading.Thread(target=lambda: asyncio.run(run()), daemon=True)
        thread.start()
        try:
            assert begun.wait(60.0), "the server does not start"
            yield RunningService(listening.getsockname()[1], service, servers[0])
        finally:
            for server in servers:
                server.should_exit = True
            thread.join(60.0)
            service.feed.stop()
            service.run.stop()
            assert not thread.is_alive(), "the server does not stop"


def conforms(value, name):
    """Fail if a value does not conform to a schema of the service's OpenAPI document."""
    total = document()
    jsonschema.validate(
        value, {"$ref": f"#/components/schemas/{name}", "components": total["components"]}
    )
