"""A server that answers without an end is not read to the end, and neither is a store full of tags."""

from __future__ import annotations

import gzip
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from recording_server import FakeStore
from traced_memory import little_memory

from freemesh_ray.storage.owner import Owner
from freemesh_ray.tracking import TrackingError, bounded, sync
from freemesh_ray.tracking.bounded import Bounded
from freemesh_ray.tracking.killed_runs import fail_killed_runs
from freemesh_ray.tracking.mlflow_run import MLflowRun
from freemesh_ray.tracking.mlflow_store import connect, mlflow_client

#: Bytes that are sent at a time, before packing, and how much the socket's buffers may take beside what is read.
PIECE, BUFFERS = b" " * (1 << 20), 64 << 20


class Endless:
    """A server whose answers have no end; it knows how much of them was taken."""

    def __init__(self, packed: bool) -> None:
        self.sent, self.packed = 0, packed
        server, piece = self, gzip.compress(PIECE) if packed else PIECE

        class Handler(BaseHTTPRequestHandler):
            def answer(self) -> None:
                self.rfile.read(int(self.headers.get("Content-Length") or 0))
                self.send_response(200)
                self.send_header("Content-Type", "application/json")
                if packed:
                    self.send_header("Content-Encoding", "gzip")
                self.end_headers()
                with suppress(OSError):
                    while True:
                        self.wfile.write(piece)
                        server.sent += len(PIECE)

            do_GET = do_POST = answer

            def log_message(self, *_: Any) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self._server.server_address[1]}"
        threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True).start()

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()


@pytest.fixture(params=[False, True], ids=["plain", "packed"])
def endless(request: pytest.FixtureRequest) -> Iterator[Endless]:
    server = Endless(request.param)
    yield server
    server.close()


def test_an_answer_without_an_end_is_told_in_a_line(endless: Endless, tmp_path: Path) -> None:
    with MLflowRun(tmp_path / "run", uri="http://127.0.0.1:9", experiment="test", name="a"):
        pass
    mlflow_client()  # what it imports takes memory, too
    with pytest.raises(TrackingError) as raised, little_memory(8 * bounded.MOST_BYTES):
        sync(tmp_path / "run", endless.url)
    assert "answers with more than 16,000,000 bytes): have whoever filled it" in str(raised.value)
    assert "\n" not in str(raised.value)
    assert endless.packed or endless.sent < bounded.MOST_BYTES + BUFFERS


def test_runs_that_are_full_of_tags_are_read_one_by_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And those that were killed are found among them."""
    monkeypatch.setattr(bounded, "MOST_BYTES", 2_000_000)
    told = {f"freemesh.{name}": text for name, text in Owner.here().told().items()}
    told |= {"freemesh.process": f"{Owner.here().process.split(':')[0]}:4194305:5"}
    store = FakeStore()
    with store.running():
        for i in range(5):
            filling = {f"t{j}": "y" * 5000 for j in range(300)}
            store.add(tags={"freemesh.id": f"20260101T000000-{i}", **told, **filling})
        fail_killed_runs(store.url, "test", "none", [tmp_path], time.monotonic() + 600)
        assert {run.status for run in store.runs.values()} == {"FAILED"}
        store.add(tags={"freemesh.id": "20260101T000000-x", **told} | {f"t{j}": "y" * 5000 for j in range(500)})
        with pytest.raises(Exception, match="answers with more than 2,000,000 bytes"):
            fail_killed_runs(store.url, "test", "none", [tmp_path], time.monotonic() + 600)


def test_only_our_own_calls_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bounded, "MOST_BYTES", 1000)
    store = FakeStore()
    with store.running():
        run = store.add(tags={"t": "y" * 5000})
        ours, theirs = connect(store.url), mlflow_client()(store.url, store.url)
        assert isinstance(ours, Bounded)
        assert ours.tracking_uri == store.url
        for _ in range(2):
            assert theirs.get_run(run.run_id).data.tags["t"] == "y" * 5000
            with pytest.raises(Exception, match="answers with more than 1,000 bytes"):
                ours.get_run(run.run_id)
