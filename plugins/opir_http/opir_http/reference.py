"""The reference page of the HTTP interface, generated from its OpenAPI document."""

from collections.abc import Iterator
from typing import Any

from attrs import fields

from opir_core.scene import info_of
from opir_http.routes import document
from opir_http.settings import LIVE, HttpSettings

_HEAD = """# The HTTP interface

Which requests does `opir serve` answer? [Serve a scene](../how-to/serve.md) has examples. The service has this page as
an OpenAPI 3.1 document at `/openapi.json`. Errors are problem details (RFC 9457), `application/problem+json`. If the
service has a bearer token, all paths except `/`, `/page/…`, `/health/…` and `/openapi.json` need it."""


def reference_page() -> str:
    """Return the page as Markdown."""
    paths = document()["paths"]
    shared = _shared(
        [operation["responses"] for item in paths.values() for operation in item.values()]
    )
    listed = "; ".join(f"**{status}** {meaning}" for status, meaning in shared.items())
    everywhere = f"Every request may be answered with these: {listed}."
    routes = [line for path, item in paths.items() for line in _route(path, item, shared)]
    return "\n".join([_HEAD, "", everywhere, *routes, *_settings()]) + "\n"


def _shared(responses: list[dict[str, Any]]) -> dict[str, str]:
    """Return the statuses, with their meaning, that all operations have."""
    return {
        status: response["description"]
        for status, response in responses[0].items()
        if all(
            answers.get(status, {}).get("description") == response["description"]
            for answers in responses
        )
    }


def _route(path: str, item: dict[str, Any], shared: dict[str, str]) -> Iterator[str]:
    for method, operation in item.items():
        yield from ("", f"## {method.upper()} {path}", "", f"{operation['summary']}.")
        if "description" in operation:
            yield from ("", operation["description"])
        parameters = operation.get("parameters", [])
        if parameters:
            yield from ("", "| parameter | in | meaning |", "|---|---|---|")
        for parameter in parameters:
            yield f"| `{parameter['name']}` | {parameter['in']} | {_words(parameter)} |"
        omitted = {*shared.items(), ("200", operation["summary"])}
        meanings = {
            status: response["description"] for status, response in operation["responses"].items()
        }
        answers = "; ".join(
            f"**{status}** {meaning}"
            for status, meaning in meanings.items()
            if (status, meaning) not in omitted
        )
        yield from ("", f"Answers: {answers}.") if answers else ()


def _words(parameter: dict[str, Any]) -> str:
    schema = parameter["schema"]
    kind = [
        schema["type"]
        if "enum" not in schema
        else " or ".join(f"`{word}`" for word in schema["enum"])
    ]
    bounds = [
        f"{name} {schema[name]}"
        for name in ("minimum", "maximum", "maxLength", "default")
        if name in schema
    ]
    meaning = [parameter["description"]] if "description" in parameter else []
    return "; ".join([*kind, *bounds, *meaning])


def _settings() -> Iterator[str]:
    yield from ("", "## Settings of the service", "", "The block `http` of the configuration.", "")
    yield from ("| key | default | meaning | while running |", "|---|---|---|---|")
    for attribute in fields(HttpSettings):
        when = "applied at once" if attribute.name in LIVE else "needs a restart"
        yield f"| `{attribute.name}` | `{attribute.default}` | {info_of(attribute).help} | {when} |"
