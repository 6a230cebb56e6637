"""A Ray cluster that tests start, submit jobs to, hurt and end: real nodes with token authentication, on this machine.

Its nodes are what several machines would be, each a ``ray start --block`` with a raylet, agents and workers of its own.
Every process of a node, whoever started it, carries the node's mark in its environment, and is found by that.
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

from processes import QUIET, free_port, outside

RAY = str(Path(sys.executable).with_name("ray"))
MARK = "FREEMESH_TEST_NODE"
#: Of the nodes, by their number, all on the loopback device: Ray would take 127.0.0.1 for the machine's outer address.
ADDRESS = "127.0.77.{}"
#: What ends a job.
OVER = ("SUCCEEDED", "FAILED", "STOPPED")
#: Bytes: the least that Ray takes is 75 MB.
OBJECT_STORE = 80_000_000
#: A cluster without what tests do not look at, which misses a dead node in seconds and finds this Python first.
LIGHT: Mapping[str, str] = {
    "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
    "RAY_health_check_initial_delay_ms": "1000",
    "RAY_health_check_period_ms": "500",
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_enable_metrics_collection": "0",
    "RAY_enable_open_telemetry": "0",
    "RAY_enable_worker_prestart": "0",
    "RAY_prestart_worker_first_driver": "0",
    "RAY_COLOR_PREFIX": "0",
    "OMP_NUM_THREADS": "1",
}


class Cluster:
    """A head, which only directs, and workers, in a ``with`` block.

    Attributes:
        address: of Ray, as in RAY_ADDRESS.
        url: of the dashboard and the jobs' server.
        token: that every request must show.
        environment: variables of a process that talks to the cluster, beside its own: address and token.
    """

    def __init__(self, workers: int = 2, *, cpus: int = 2, **environment: str) -> None:
        """Describe it.

        Args:
            workers: how many nodes beside the head, ``worker-0`` and on.
            cpus: of each worker; the head has none.
            environment: variables of all nodes, as ``PYTHONPATH=str(ROOT)`` for jobs that bring no code along.
        """
        self._workers, self._cpus = workers, cpus
        self._port, dashboard = free_port(), free_port()
        self.address, self.url = f"{ADDRESS.format(1)}:{self._port}", f"http://127.0.0.1:{dashboard}"
        self.token = secrets.token_hex(16)
        self._folder = Path(tempfile.mkdtemp(prefix="ray-"))  # short: sockets' paths have at most 107 characters
        self.environment = {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": self.token, "RAY_ADDRESS": self.url}
        # The head's memory is on disk, so that it can be started again.
        memory = {"RAY_gcs_storage": "rocksdb", "RAY_gcs_storage_path": str(self._folder / "gcs")}
        own = {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": self.token}
        self._variables = {**LIGHT, **QUIET, **memory, **environment, **own}
        self._nodes: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> Self:
        try:
            self.start_head()
            for _ in range(self._workers):
                self.add_worker(wait=False)
            until(self._complete, 300, self.trouble)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        for name in list(self._nodes):
            self._kill(name)
        shutil.rmtree(self._folder, ignore_errors=True)

    # ---- nodes ------------------------------------------------------------------------------------------------------

    def start_head(self) -> None:
        """Start the head, or start it again on the same ports, and wait until it takes jobs."""
        port, dashboard = str(self._port), self.url.rpartition(":")[2]
        client = str(free_port())
        self._start("head", "--head", "--port", port, "--dashboard-port", dashboard, "--dashboard-host", "127.0.0.1",
                    "--ray-client-server-port", client, "--num-cpus", "0", "--no-monitor")  # fmt: skip
        until(lambda: "head" in self.nodes() and self._get("/api/jobs/") is not None, 120, self.trouble)

    def kill_head(self) -> None:
        """Kill every process of the head, as a power cut would."""
        self._kill("head")
        # Its workers' command lines, on this same machine, would have the next head think that it still runs.
        (self._folder / "head" / "ray_current_cluster").unlink(missing_ok=True)

    def add_worker(self, wait: bool = True) -> int:
        """Start one more worker; its number."""
        i = sum(name != "head" for name in self._nodes)
        name = f"worker-{i}"
        # Each node unpacks jobs' code in a folder of its own, but an agent looks for their logs in the head's.
        logs = (self._folder / "head" / "session_latest" / "logs").resolve()
        session = self._folder / name / logs.parent.name
        session.mkdir(parents=True)
        (session / "logs").symlink_to(logs)
        self._start(name, "--address", self.address, "--num-cpus", str(self._cpus))
        if wait:
            until(lambda: name in self.nodes(), 120, self.trouble)
        return i

    def kill_worker(self, i: int) -> None:
        """Kill every process of a worker, as a power cut would."""
        self._kill(f"worker-{i}")

    def nodes(self) -> dict[str, str]:
        """The nodes that are alive, as the head knows them: name -> Ray's id; nothing while the head is away."""
        found = self._get("/api/v0/nodes?limit=100")
        listed = found["data"]["result"]["result"] if found else []
        return {node["node_name"]: node["node_id"] for node in listed if node["state"] == "ALIVE"}

    def actors(self, kind: str) -> dict[str, list[int]]:
        """The living actors of a class whose name holds ``kind``: node name -> their process ids."""
        found = self._get("/api/v0/actors?limit=1000&detail=1")
        names = {key: name for name, key in self.nodes().items()}
        by_node: dict[str, list[int]] = {}
        for actor in found["data"]["result"]["result"] if found else []:
            if actor["state"] == "ALIVE" and kind in actor["class_name"] and actor["node_id"] in names:
                by_node.setdefault(names[actor["node_id"]], []).append(actor["pid"])
        return by_node

    # ---- jobs -------------------------------------------------------------------------------------------------------

    def submit(self, line: str, *, cpus: float = 0, **variables: str) -> str:
        """Submit a job that brings no code along; its id.

        Args:
            line: a shell's.
            cpus: that its driver takes; without any it runs on the head.
            variables: of its environment.
        """
        asked = {"entrypoint": line, "runtime_env": {"env_vars": variables}, "entrypoint_num_cpus": cpus}
        taken: list[str] = []

        def accepted() -> bool:
            """Not yet, where a head that has just come back knows none of its own nodes' agents: that is a 500."""
            try:
                taken.append(self._request("/api/jobs/", asked)["submission_id"])
            except urllib.error.HTTPError as error:
                if error.code != 500:
                    raise
            return bool(taken)

        until(accepted, 60, self.trouble)
        return taken[0]

    def status(self, job: str) -> str:
        """PENDING, RUNNING, SUCCEEDED, FAILED or STOPPED; empty while the head is away."""
        found = self._get(f"/api/jobs/{job}")
        return found["status"] if found else ""

    def logs(self, job: str) -> str:
        """What the job has printed so far; empty while the head is away."""
        found = self._get(f"/api/jobs/{job}/logs")
        return found["logs"] if found else ""

    def jobs(self) -> list[str]:
        """The ids of all jobs so far."""
        return [job["submission_id"] for job in self._get("/api/jobs/") or []]

    def stop(self, job: str) -> None:
        """Ask a job to stop: its process gets SIGTERM."""
        self._request(f"/api/jobs/{job}/stop", {})

    def finish(self, job: str, seconds: float = 300) -> str:
        """Wait until a job is over; its last status."""
        until(lambda: self.status(job) in OVER, seconds, lambda: f"{job} goes on:\n{self.logs(job)}")
        return self.status(job)

    def ray(self, *arguments: str, **options: Any) -> subprocess.CompletedProcess[str]:
        """Run the ``ray`` command with the cluster's address and token."""
        variables = outside() | LIGHT | self.environment
        return subprocess.run([RAY, *arguments], env=variables, capture_output=True, text=True, timeout=300, **options)

    # ---- underneath -------------------------------------------------------------------------------------------------

    def trouble(self) -> str:
        """What the nodes printed last."""
        return "\n".join(f"{path.name}: {path.read_text()[-2000:]}" for path in sorted(self._folder.glob("*.log")))

    def _start(self, name: str, *arguments: str) -> None:
        ip = ADDRESS.format(1 + list(dict.fromkeys([*self._nodes, name])).index(name))
        common = [
            "--block", "--node-ip-address", ip, "--node-name", name, "--labels", f"node={name}",
            "--resources", json.dumps({name: 1}), "--temp-dir", str(self._folder / name),
            "--object-store-memory", str(OBJECT_STORE), "--num-gpus", "0", "--min-worker-port", "0",
            "--max-worker-port", "0", "--dashboard-agent-listen-port", str(free_port()),
            "--include-log-monitor", "false", "--disable-usage-stats",
        ]  # fmt: skip
        variables = outside() | self._variables | {MARK: self._mark(name)}
        with (self._folder / f"{name}.log").open("ab") as log:
            self._nodes[name] = subprocess.Popen(
                [RAY, "start", *arguments, *common], env=variables, stdout=log, stderr=log, stdin=subprocess.DEVNULL,
                start_new_session=True, cwd=self._folder,
            )  # fmt: skip

    def _complete(self) -> bool:
        """Whether all nodes are there; one that a busy machine did not start in Ray's half a minute is started anew."""
        for name, process in list(self._nodes.items()):
            if name != "head" and process.poll() is not None:
                self._kill(name)
                self._start(name, "--address", self.address, "--num-cpus", str(self._cpus))
        return len(self.nodes()) == self._workers + 1

    def _mark(self, name: str) -> str:
        return f"{self._folder.name}/{name}"

    def _kill(self, name: str) -> None:
        process = self._nodes[name]
        while found := marked(self._mark(name)):
            for pid in found:
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            time.sleep(0.02)
        process.wait()

    def _get(self, path: str) -> Any:
        try:
            return self._request(path)
        except OSError:  # HTTPError among them: the head is not there, or not yet
            return None

    def _request(self, path: str, body: object = None) -> Any:
        data = None if body is None else json.dumps(body).encode()
        headers = {"Content-Type": "application/json", "Authorization": f"Bearer {self.token}"}
        with urllib.request.urlopen(urllib.request.Request(self.url + path, data, headers), timeout=30) as answer:
            return json.load(answer)


def until(ready: Callable[[], bool], seconds: float, why: Callable[[], str]) -> None:
    """Wait for something.

    Raises:
        TimeoutError: it did not come; with ``why()``.
    """
    give_up = time.monotonic() + seconds
    while not ready():
        if time.monotonic() > give_up:
            raise TimeoutError(why())
        time.sleep(0.1)


def marked(mark: str) -> list[int]:
    """The processes that carry a node's mark."""
    wanted, found = f"{MARK}={mark}\0".encode(), []
    for place in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if wanted in (place / "environ").read_bytes() and (place / "stat").read_text().rpartition(")")[2][1] != "Z":
                found.append(int(place.name))
    return found
