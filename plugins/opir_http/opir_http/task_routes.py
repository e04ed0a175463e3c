"""The routes by which an operator points sensors."""

import asyncio
from typing import Annotated

import msgspec
from litestar import HttpMethod, Response, delete, put, route
from litestar.params import PathParameter
from msgspec import UNSET

from opir_http.answers import SCHEMAS, Task, TaskedAnswer
from opir_http.openapi import described
from opir_http.problems import ProblemError
from opir_http.reading import json_object
from opir_http.served import AnyRequest, json_answer, lateness, served_of

_SENSOR_ID = PathParameter(min_length=1, description="id of a sensor with a narrow field")


# Registered before the other routes of its path, as that of the configuration.
@route(
    "/sensors/{sensor_id:str}/task",
    http_method=HttpMethod.OPTIONS,
    status_code=204,
    include_in_schema=False,
)
async def task_options(sensor_id: Annotated[str, _SENSOR_ID]) -> Response[None]:
    """Methods of a task."""
    return Response(None, media_type="text/plain", headers={"Allow": "DELETE, OPTIONS, PUT"})


@put(
    "/sensors/{sensor_id:str}/task",
    **described(
        "The sensor has the task",
        body={
            "schema": {"$ref": f"{SCHEMAS}Task"},
            "examples": {
                "place": {"value": {"place_deg": [41.0, 127.0]}},
                "track": {"value": {"track_id": 0, "mode": "stare"}},
            },
        },
        problems=(403, 404, 409, 415, 422, 429),
    ),
)
async def task(
    request: AnyRequest, sensor_id: Annotated[str, _SENSOR_ID]
) -> Response[TaskedAnswer]:
    """Point a sensor.

    It looks at a place on the ground or follows a track, or looks in a mode, until another task or
    the end of the lap; the scene's director commands the other sensors. A task that it cannot do is
    refused with the reason, and it goes on as it was.
    """
    body = json_object(await request.body())
    try:
        wanted = msgspec.convert(body, Task)
    except msgspec.ValidationError as error:
        raise ProblemError(422, str(error)) from error
    places = (wanted.place_deg, wanted.track_id).count(UNSET)
    if not places or (places > 1 and not wanted.mode):
        raise ProblemError(422, "give place_deg or track_id, one of both, or a mode alone")
    return await _tasked(request, sensor_id, wanted)


@delete(
    "/sensors/{sensor_id:str}/task",
    status_code=200,
    **described("The director commands it again", problems=(403, 404, 409, 429)),
)
async def untask(
    request: AnyRequest, sensor_id: Annotated[str, _SENSOR_ID]
) -> Response[TaskedAnswer]:
    """End the task of a sensor."""
    return await _tasked(request, sensor_id, Task())


async def _tasked(request: AnyRequest, sensor_id: str, wanted: Task) -> Response[TaskedAnswer]:
    service = served_of(request).service
    answer = await asyncio.to_thread(service.task, sensor_id, wanted)
    return json_answer(answer, 200, lateness(service))
