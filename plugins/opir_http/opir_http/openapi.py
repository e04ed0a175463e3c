"""The OpenAPI 3.1 document: litestar describes the routes, msgspec the schemas of answers."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
from litestar import Litestar
from litestar.openapi import OpenAPIConfig, ResponseSpec
from litestar.openapi.spec import Components, Operation, SecurityScheme

from opir_http.answers import ANSWERS, SCHEMAS, ProblemAnswer, Schema
from opir_http.problems import PROBLEM_TYPE, TITLES
from opir_http.queries import Query
from opir_http.schemas import Config, detection, trigger
from opir_http.settings import CONFIGURATION_SHARE, MAXIMUM_BODY_BYTES

_DESCRIPTION = (
    "Unclassified and notional; for tests of systems that receive such events. Request bodies have"
    f" at most {MAXIMUM_BODY_BYTES} bytes, a configuration {CONFIGURATION_SHARE} times those of the"
    " present one, if that is more. Errors are problem details (RFC 9457)."
)
_RETRY_AFTER = {
    "Retry-After": {"schema": {"type": "string"}, "description": "time until the next attempt, s"}
}
#: Statuses that the answer to any request may have.
_ANY_REQUEST = (400, 401, 405, 408, 413, 421, 500)


def described(
    answer: str | None = None,
    *,
    query: type[Query] = Query,
    headers: Sequence[Schema] = (),
    body: Schema | None = None,
    links: Schema | None = None,
    problems: Sequence[int] = (),
    responses: dict[int, ResponseSpec] | None = None,
) -> dict[str, Any]:
    """Return the arguments of a litestar route that describe it.

    The docstring of the route has its summary and description. `answer` describes the answer, if
    the summary does not. `headers` are parameters, `body` is a media type and `links` are links of
    the answer, as in OpenAPI. `problems` are the statuses of errors beside those of any request.
    """

    @dataclass
    class Described(Operation):
        def __post_init__(self) -> None:
            summary, _, description = (self.description or "").partition("\n\n")
            details: Any = self
            details.summary = " ".join(summary.split()).rstrip(".")
            details.description = " ".join(description.split()) or None
            details.parameters = [*(self.parameters or ()), *headers, *_parameters(query)]
            if body is not None:
                details.request_body = {"required": True, "content": {"application/json": body}}
            success = details.responses[min(details.responses)]
            success.links = links
            success.description = answer or self.summary
            if "429" in details.responses:
                details.responses["429"].headers = _RETRY_AFTER

    errors = {
        status: ResponseSpec(
            ProblemAnswer,
            description=TITLES[status],
            media_type=PROBLEM_TYPE,
            generate_examples=False,
        )
        for status in sorted({*_ANY_REQUEST, *problems})
    }
    return {
        "operation_class": Described,
        "responses": errors | (responses or {}),
        "opt": {"query": query},
    }


def _parameters(query: type[Query]) -> list[Schema]:
    _, schemas = msgspec.json.schema_components([query])
    schema = schemas[query.__name__]
    return [
        {
            "name": name,
            "in": "query",
            "required": name in schema["required"],
            "description": value.pop("description", None),
            "schema": value,
        }
        for name, value in schema["properties"].items()
    ]


def document_of(routes: Sequence[Any], summary: str) -> dict[str, Any]:
    """Return the OpenAPI document of routes."""
    described_app = Litestar(
        routes,
        openapi_config=OpenAPIConfig(
            title="opir",
            version="1.0",
            summary=summary,
            description=_DESCRIPTION,
            use_handler_docstrings=True,
            operation_id_creator=_operation_id,
            security=[{}, {"token": []}],
            components=Components(
                security_schemes={"token": SecurityScheme(type="http", scheme="bearer")}
            ),
        ),
    )
    document = described_app.openapi_schema.to_schema()
    document["components"]["schemas"] = _schemas()
    return document


def _operation_id(route: Any, *_: Any) -> str:
    """Return the name of a route in camel case."""
    first, *words = route.handler_name.split("_")
    return str(first) + "".join(word.title() for word in words)


def _schemas() -> Schema:
    """Return all schemas: those that litestar makes have neither closed objects nor lengths."""
    (*_, event), schemas = msgspec.json.schema_components(
        [Config, *ANSWERS], ref_template=f"{SCHEMAS}{{name}}"
    )
    # `items: false`, which msgspec writes of tuples, stops generators of clients.
    schemas["Task"]["properties"]["place_deg"]["items"] = {"type": "number"}
    return {**schemas, **detection(), "Trigger": trigger(), "StreamEvent": event}
