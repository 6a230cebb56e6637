"""Errors as clients get them."""

from __future__ import annotations

from collections.abc import Mapping

from starlette.responses import Response

from freemesh_ray.serving.answer import refusal


def error_response(status: int, line: str, headers: Mapping[str, str]) -> Response:
    """The response with an error's line."""
    answer = refusal(status, line)
    return Response(answer.body, status, dict(headers), answer.media_type)
