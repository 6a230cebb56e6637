"""Little HTTP servers that keep all they are sent: one that knows nothing, and one that answers as MLflow's does."""

from __future__ import annotations

import base64
import json
import re
import threading
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

#: MLflow's errors.
ABSENT = (404, {"error_code": "RESOURCE_DOES_NOT_EXIST", "message": "there is none"})
REFUSED = (400, {"error_code": "INVALID_PARAMETER_VALUE", "message": "not here"})


def basic(login: str) -> str:
    """What an ``Authorization`` header says of ``user:password``."""
    return f"Basic {base64.b64encode(login.encode()).decode()}"


@dataclass
class Request:
    """One request: method, path with query, headers as text, body."""

    method: str
    path: str
    headers: str
    body: bytes


class Recorder:
    """A server of 127.0.0.1 that keeps every request; it answers ``{}``."""

    def __init__(self) -> None:
        self.requests: list[Request] = []
        recorder = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"
            disable_nagle_algorithm = True

            def answer(self) -> None:
                body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
                request = Request(self.command, self.path, str(self.headers), body)
                recorder.requests.append(request)
                status, content, more = recorder.answer(request)
                text = b"" if content is None else json.dumps(content).encode()
                self.send_response(status)
                for name, value in {
                    "Content-Type": "application/json",
                    "Content-Length": str(len(text)),
                    **more,
                }.items():
                    self.send_header(name, value)
                self.end_headers()
                self.wfile.write(text)

            do_GET = do_POST = do_PUT = do_PATCH = do_DELETE = do_HEAD = answer

            def log_message(self, *_: Any) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self.netloc = f"127.0.0.1:{self._server.server_address[1]}"
        self.url = f"http://{self.netloc}"
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True)

    def answer(self, request: Request) -> tuple[int, Any, dict[str, str]]:
        """Status, JSON (None: an empty body) and headers that answer a request."""
        return 200, {}, {}

    @contextmanager
    def running(self) -> Iterator[None]:
        """Serve in the block."""
        self._thread.start()
        try:
            yield
        finally:
            self._server.shutdown()
            self._server.server_close()
            self._thread.join(10)


@dataclass
class StoredRun:
    """A run as the store has it."""

    run_id: str
    name: str
    status: str
    started: int
    artifacts: str
    tags: dict[str, str] = field(default_factory=dict)
    params: dict[str, str] = field(default_factory=dict)
    metrics: list[tuple[str, Any, int]] = field(default_factory=list)
    stage: str = "active"

    def told(self) -> dict[str, Any]:
        """As MLflow's JSON."""
        info = {
            "run_id": self.run_id, "run_uuid": self.run_id, "experiment_id": "1", "run_name": self.name,
            "status": self.status, "start_time": self.started, "lifecycle_stage": self.stage,
            "artifact_uri": self.artifacts,
        }  # fmt: skip
        texts = {"tags": self.tags, "params": self.params}
        data = {name: [{"key": key, "value": text} for key, text in texts[name].items()] for name in texts}
        return {"info": info, "data": data}


class FakeStore(Recorder):
    """The part of MLflow's REST API that tracking uses, in memory, and what an ill-willed server may do with it.

    Attributes:
        runs: by MLflow's id.
        views: the tags of the experiment.
        place: of a new run's artifacts, from its id.
        redirect: the address that a request is sent on to; None: it is answered.
        filters: whether a search keeps to what it is asked for.
        login: ``user:password`` of those that it answers; None: all.
    """

    def __init__(self) -> None:
        super().__init__()
        self.runs: dict[str, StoredRun] = {}
        self.views: dict[str, str] = {}
        self.place: Callable[[str], str] = lambda run_id: f"mlflow-artifacts:/1/{run_id}/artifacts"
        self.redirect: Callable[[Request], str | None] = lambda request: None
        self.filters = True
        self.login: str | None = None

    def add(self, run_id: str | None = None, tags: dict[str, str] | None = None, started: int = 0) -> StoredRun:
        """One more run, RUNNING."""
        run_id = run_id or uuid.uuid4().hex
        self.runs[run_id] = StoredRun(run_id, "a run", "RUNNING", started, self.place(run_id), tags or {})
        return self.runs[run_id]

    def answer(self, request: Request) -> tuple[int, Any, dict[str, str]]:
        """As MLflow would."""
        if self.login and f"Authorization: {basic(self.login)}" not in request.headers:
            return 401, {"error_code": "UNAUTHENTICATED", "message": "who are you"}, {}
        if target := self.redirect(request):
            return 307, None, {"Location": target + request.path}
        parts = urlsplit(request.path)
        if request.method == "PUT" and "/mlflow-artifacts/" in parts.path:
            return 200, {}, {}
        asked = {key: value[0] for key, value in parse_qs(parts.query).items()}
        if request.body and request.method != "PUT":
            asked |= json.loads(request.body)
        call = "/".join(parts.path.split("/")[-2:])
        handler = {
            "experiments/get-by-name": self._experiment, "experiments/search": lambda _: (200, {"experiments": []}),
            "runs/create": self._create, "runs/get": self._get, "runs/update": self._update,
            "runs/search": self._search, "runs/log-batch": self._log, "runs/delete": self._delete,
            "runs/set-tag": self._tag, "experiments/set-experiment-tag": self._view,
        }.get(call, lambda _: REFUSED)  # fmt: skip
        status, content = handler(asked)
        return status, content, {}

    def files(self) -> list[tuple[str, bytes]]:
        """The artifacts that were sent: (MLflow's id of the run, content)."""
        puts = [request for request in self.requests if request.method == "PUT"]
        return [(unquote(request.path).split("/artifacts/1/")[1].split("/")[0], request.body) for request in puts]

    def _experiment(self, asked: dict[str, Any]) -> tuple[int, Any]:
        about = {"experiment_id": "1", "name": asked["experiment_name"], "lifecycle_stage": "active"}
        return 200, {"experiment": about | {"artifact_location": "mlflow-artifacts:/1"}}

    def _create(self, asked: dict[str, Any]) -> tuple[int, Any]:
        run = self.add(tags={tag["key"]: tag["value"] for tag in asked.get("tags", [])}, started=asked["start_time"])
        run.name = asked["run_name"]
        return 200, {"run": run.told()}

    def _get(self, asked: dict[str, Any]) -> tuple[int, Any]:
        run = self.runs.get(asked["run_id"])
        return (200, {"run": run.told()}) if run else ABSENT

    def _update(self, asked: dict[str, Any]) -> tuple[int, Any]:
        run = self.runs.get(asked["run_id"])
        if run is None:
            return ABSENT
        run.status = asked.get("status", run.status)
        return 200, {"run_info": run.told()["info"]}

    def _delete(self, asked: dict[str, Any]) -> tuple[int, Any]:
        run = self.runs.get(asked["run_id"])
        if run is None:
            return ABSENT
        run.stage = "deleted"
        return 200, {}

    def _tag(self, asked: dict[str, Any]) -> tuple[int, Any]:
        run = self.runs.get(asked["run_id"])
        if run is None:
            return ABSENT
        run.tags[asked["key"]] = asked["value"]
        return 200, {}

    def _view(self, asked: dict[str, Any]) -> tuple[int, Any]:
        self.views[asked["key"]] = asked["value"]
        return 200, {}

    def _log(self, asked: dict[str, Any]) -> tuple[int, Any]:
        run = self.runs.get(asked["run_id"])
        if run is None:
            return ABSENT
        run.tags |= {tag["key"]: tag["value"] for tag in asked.get("tags", [])}
        run.params |= {param["key"]: param["value"] for param in asked.get("params", [])}
        run.metrics += [(metric["key"], metric["value"], metric["step"]) for metric in asked.get("metrics", [])]
        return 200, {}

    def _search(self, asked: dict[str, Any]) -> tuple[int, Any]:
        query = asked.get("filter", "")
        tags = dict(re.findall(r"tags\.`([^`]+)` = '([^']*)'", query))
        status = re.search(r"attributes\.status = '(\w+)'", query)
        found = [
            run.told() for run in list(self.runs.values())
            if not self.filters
            or (tags.items() <= run.tags.items() and (status is None or status.group(1) == run.status))
        ]  # fmt: skip
        if not self.filters:
            return 200, {"runs": found}
        first = int(asked.get("page_token") or 0)
        last = first + int(asked.get("max_results", 1000))
        return 200, {"runs": found[first:last]} | ({"next_page_token": str(last)} if last < len(found) else {})
