"""Describe a served system by OpenAPI, for those who generate a client."""

from __future__ import annotations

from http import HTTPStatus

from merap.systems.description import (
    Interface,
    Json,
    adaptation_options_schema,
    execute_schema,
    monitor_schema,
)

ERROR_SCHEMA: Json = {
    "type": "object",
    "properties": {"error": {"type": "string", "description": "one line: the fault, and what is allowed"}},
    "required": ["error"],
}
_A_SCHEMA: Json = {"type": "object", "description": "a JSON Schema, draft 2020-12"}


def openapi(interface: Interface) -> Json:
    """Build the description in OpenAPI 3.1, whose schemas are JSON Schema."""
    change = execute_schema(interface)
    executed = _answer("the executed change", change)
    for status, why in (
        (HTTPStatus.BAD_REQUEST, "the body is not as asked"),
        (HTTPStatus.CONFLICT, "not possible now, or decided at other counters; nothing has happened"),
        (HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "the body is too large"),
        (HTTPStatus.SERVICE_UNAVAILABLE, "the system itself has failed"),
    ):
        executed[str(status.value)] = _content(why, ERROR_SCHEMA)
    request = {"required": True, "content": {"application/json": {"schema": change}}}
    return {
        "openapi": "3.1.0",
        "info": {"title": f"{interface.system}, a managed system", "version": "1"},
        "paths": {
            "/monitor": _get("the observation now", monitor_schema(interface)),
            "/monitor_schema": _get("the schema of /monitor", _A_SCHEMA),
            "/adaptation_options": _get("all that can be done", adaptation_options_schema(interface)),
            "/adaptation_options_schema": _get("the schema of /adaptation_options", _A_SCHEMA),
            "/execute_schema": _get("the schema of requests to /execute and of its answers", _A_SCHEMA),
            "/execute": {
                "put": {
                    "summary": "take an action, or begin an episode",
                    "requestBody": request,
                    "responses": executed,
                }
            },
        },
    }


def _get(summary: str, schema: Json) -> Json:
    return {"get": {"summary": summary, "responses": _answer(summary, schema)}}


def _answer(description: str, schema: Json) -> Json:
    return {str(HTTPStatus.OK.value): _content(description, schema)}


def _content(description: str, schema: Json) -> Json:
    return {"description": description, "content": {"application/json": {"schema": schema}}}
