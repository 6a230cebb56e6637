"""What the HTTP app counts, as Prometheus reads it."""

from __future__ import annotations

from http import HTTPStatus

from prometheus_client import (
    CONTENT_TYPE_LATEST,
    CollectorRegistry,
    Counter,
    Gauge,
    Histogram,
    disable_created_metrics,
    generate_latest,
)

#: The path whose requests cost something.
MESH = "/mesh"

#: Why requests are turned away, by status.
REASONS: dict[int, str] = {
    HTTPStatus.UNAUTHORIZED: "token",
    HTTPStatus.FORBIDDEN: "host",
    HTTPStatus.REQUEST_TIMEOUT: "upload",
    HTTPStatus.REQUEST_ENTITY_TOO_LARGE: "size",
    HTTPStatus.SERVICE_UNAVAILABLE: "busy",
    HTTPStatus.GATEWAY_TIMEOUT: "time",
}

#: Upper bounds of the histogram's buckets, in seconds.
BUCKETS = (0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0, 60.0)

#: Counted for a client that left before it was answered; no client sees it.
CLIENT_LEFT = 499


class Counters:
    """The counters of one HTTP app, from its start on."""

    def __init__(self) -> None:
        disable_created_metrics()
        self._registry = CollectorRegistry()
        self._requests = Counter(
            "freemesh_requests", "requests by path and status", ["path", "status"], registry=self._registry
        )
        self._rejected = Counter(
            "freemesh_rejected", "requests for a mesh turned away", ["reason"], registry=self._registry
        )
        self._seconds = Histogram(
            "freemesh_request_seconds", "wall time of requests for a mesh", buckets=BUCKETS, registry=self._registry
        )
        self._elements = Counter("freemesh_elements", "quadrilaterals handed out", registry=self._registry)
        self._retries = Counter("freemesh_retries", "meshes begun anew because a mesher died", registry=self._registry)
        self._in_flight = Gauge("freemesh_in_flight", "requests for a mesh in the server", registry=self._registry)
        self._cut = Counter("freemesh_cut", "connections cut off", ["reason"], registry=self._registry)
        for reason in REASONS.values():
            self._rejected.labels(reason)

    def began(self) -> None:
        """A request for a mesh came in."""
        self._in_flight.inc()

    def ended(self, seconds: float) -> None:
        """It was answered, or its client left."""
        self._in_flight.dec()
        self._seconds.observe(seconds)

    def answered(self, path: str, status: int) -> None:
        """Any request was answered; ``path`` is one of few, whatever clients ask for."""
        self._requests.labels(path, str(status)).inc()
        if path == MESH and status in REASONS:
            self._rejected.labels(REASONS[status]).inc()

    def meshed(self, elements: int) -> None:
        """A mesh was handed out."""
        self._elements.inc(elements)

    def retried(self) -> None:
        """A mesher died while it meshed."""
        self._retries.inc()

    def cut(self, reason: str) -> None:
        """A connection was cut off: one of few reasons."""
        self._cut.labels(reason).inc()

    def page(self) -> tuple[bytes, str]:
        """All counters in Prometheus' text format, and its content type."""
        return generate_latest(self._registry), CONTENT_TYPE_LATEST
