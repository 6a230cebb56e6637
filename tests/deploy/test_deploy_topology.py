"""Compose's topology on the loopback device: the main job run on it, who is let in, and where it listens."""

from __future__ import annotations

import base64
import ipaddress
import json
import shutil
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import manifests
import pytest
from loopback import own_network

from freemesh_ray.tracking import mlflow_store

psycopg2 = pytest.importorskip("psycopg2")
pytest.importorskip("flask_wtf", reason="MLflow's login needs it: pip install mlflow[auth]")
topology = pytest.importorskip("topology")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(topology.postgres_programs() is None, reason="Postgres is not installed"),
    pytest.mark.skipif(shutil.which("wget") is None, reason="wget, by which health is checked, is not installed"),
]


def status(url: str, **headers: str) -> int:
    """The status that answers a request."""
    try:
        with urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=60) as answer:
            return answer.status
    except urllib.error.HTTPError as error:
        return error.code


@dataclass
class Deployment:
    """What runs, and who may ask it.

    Attributes:
        services: the processes.
        alone: whether they are in a network of their own.
        jobs, mlflow: addresses of Ray's Jobs API and of MLflow.
        bearer, basic: headers that authenticate to one and the other.
        listening: addresses that a process was seen to listen on.
    """

    services: Any
    alone: bool
    jobs: str
    mlflow: str
    bearer: dict[str, str]
    basic: dict[str, str]
    listening: set[str]

    def look(self) -> None:
        """See who listens, and where."""
        for process in self.services.processes():
            with topology.vanishing():
                sockets = process.net_connections("tcp")
                self.listening |= {each.laddr.ip for each in sockets if each.status == "LISTEN"}

    def job(self) -> dict[str, Any]:
        """The one job, as the Jobs API has it."""
        request = urllib.request.Request(f"{self.jobs}/api/jobs/", headers=self.bearer)
        with urllib.request.urlopen(request, timeout=60) as answer:
            (listed,) = json.load(answer)
        return listed


@pytest.fixture(scope="module")
def deployment() -> Iterator[Deployment]:
    with ExitStack() as stack:
        try:
            stack.enter_context(own_network())
            alone = True
        except OSError:
            alone = False
        services = stack.enter_context(topology.Topology())
        jobs, mlflow = (services.here(f"http://127.0.0.1:{port}") for port in ("8265", "5000"))
        user = f"admin:{services.secrets['MLFLOW_TRACKING_PASSWORD']}"
        bearer = {"Authorization": f"Bearer {services.secrets['RAY_AUTH_TOKEN']}"}
        basic = {"Authorization": f"Basic {base64.b64encode(user.encode()).decode()}"}
        yield Deployment(services, alone, jobs, mlflow, bearer, basic, set())


@pytest.fixture(scope="module")
def done(deployment: Deployment) -> Deployment:
    """The README's main job, cut to seconds, of the source that is installed: a copy would compile its kernels."""
    (words,) = [
        words for words in manifests.readme_lines() if words[:3] == ["ray", "job", "submit"] and "train" in words
    ]
    words = [deployment.services.here(word).replace("train_default", "train_smoke") for word in words]
    assert words[5:7] == ["--working-dir", "."]
    settings = [f"--set={name}=1000" for name in ("budget.env_steps", "evaluation.interval", "checkpoint.interval")]
    submitted = deployment.services.run("worker", [*words[:5], "--no-wait", *words[7:], *settings])
    assert submitted.returncode == 0, submitted.stderr
    deadline = time.monotonic() + 600
    while deployment.job()["status"] in ("PENDING", "RUNNING") and time.monotonic() < deadline:
        deployment.look()
        time.sleep(3)
    return deployment


def test_the_job_succeeds(done: Deployment) -> None:
    job = done.job()
    assert job["status"] == "SUCCEEDED", job["message"]


def test_it_is_kept_on_the_shared_volume(done: Deployment) -> None:
    assert [path.name for path in (done.services.folder / "shared" / "runs").iterdir()] == ["smoke"]
    assert (done.services.folder / "shared" / "runs" / "smoke" / "policy.npz").is_file()


def test_it_is_in_mlflow(done: Deployment, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its metrics and its artifacts, for who logs in; both stores are those that compose.yaml gives the server."""
    monkeypatch.setenv("MLFLOW_TRACKING_USERNAME", "admin")
    monkeypatch.setenv("MLFLOW_TRACKING_PASSWORD", done.services.secrets["MLFLOW_TRACKING_PASSWORD"])
    client = mlflow_store.mlflow_client()(done.mlflow, done.mlflow)
    (run,) = client.search_runs([client.get_experiment_by_name("freemesh").experiment_id])
    assert run.info.status == "FINISHED"
    assert {"learner/critic_loss", "mesh/T1/eta_min"} <= run.data.metrics.keys()
    assert {"policy.npz", "meshes"} <= {file.path for file in client.list_artifacts(run.info.run_id)}
    assert list((done.services.folder / "artifacts").rglob(f"{run.info.run_id}/artifacts/policy.npz"))
    told = done.services.environment("postgres")
    database = {"host": told["PGHOST"], "port": told["PGPORT"], "user": "mlflow", "password": told["POSTGRES_PASSWORD"]}
    with psycopg2.connect(dbname="mlflow", **database) as connection, connection.cursor() as cursor:
        cursor.execute("SELECT run_uuid FROM runs")
        assert cursor.fetchall() == [(run.info.run_id,)]
        cursor.execute("SELECT username, is_admin FROM users")
        assert cursor.fetchall() == [("admin", True)]


def test_mlflow_asks_who_it_is(deployment: Deployment) -> None:
    url = f"{deployment.mlflow}/api/2.0/mlflow/experiments/get?experiment_id=0"
    assert status(url, **deployment.basic) == 200
    assert status(url) == 401
    for guess in ("password1234", ""):  # the first was MLflow's default
        assert status(url, Authorization=f"Basic {base64.b64encode(f'admin:{guess}'.encode()).decode()}") == 401


def test_mlflow_answers_to_its_own_names(deployment: Deployment) -> None:
    url = f"{deployment.mlflow}/api/2.0/mlflow/experiments/get?experiment_id=0"
    port = deployment.mlflow.rpartition(":")[2]
    assert status(url, Host=f"localhost:{port}", **deployment.basic) == 200
    assert status(url, Host=f"elsewhere.example:{port}", **deployment.basic) == 403


def test_ray_asks_for_the_token(deployment: Deployment) -> None:
    for path in ("/api/jobs/", "/api/version", "/nodes?view=summary"):
        assert status(deployment.jobs + path, **deployment.bearer) == 200
        assert status(deployment.jobs + path) == 401
        assert status(deployment.jobs + path, Authorization="Bearer guessed") == 403


def test_nothing_listens_beyond_loopback(done: Deployment) -> None:
    """Where there is another device, Ray listens on it for the nodes to come, whatever address it is given."""
    if not done.alone:
        pytest.skip("a network of one's own takes root's rights")
    assert len(done.listening) >= 1
    for address in map(ipaddress.ip_address, done.listening):
        assert (getattr(address, "ipv4_mapped", None) or address).is_loopback, address
