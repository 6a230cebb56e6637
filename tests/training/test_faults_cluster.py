"""Faults done to a training on a real cluster: its driver, a worker node and the head killed, its job stopped.

The training is submitted as a job and never ends by itself. docs/faults.md is the table of these tests; with
``pytest -rP`` they print its seconds.
"""

from __future__ import annotations

import os
import re
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from cluster import Cluster, until
from processes import ROOT

from freemesh_ray.training import checkpoint

pytestmark = pytest.mark.slow

RUNNER = "TransitionEnvRunner"
SETTINGS = (
    "name={name}", "runners.count=2", "budget.env_steps=100000000", "budget.minutes=null", "checkpoint.interval=2000",
    "evaluation.interval=1000000", "tracking.enabled=false", "learner.updates_per_step=0.01",
)  # fmt: skip


@pytest.fixture(scope="module")
def cluster() -> Iterator[Cluster]:
    with Cluster(workers=2, cpus=2, PYTHONPATH=str(ROOT)) as cluster:
        yield cluster


class Training:
    """A training as a job, and as the same job again."""

    def __init__(self, cluster: Cluster, home: Path, name: str) -> None:
        sets = " ".join(f"--set {setting.format(name=name)}" for setting in SETTINGS)
        self.line = f"exec {sys.executable} -m freemesh_ray train --config train_smoke.yaml --resume {sets}"
        self.cluster, self.home, self.checkpoints = cluster, home, home / "runs" / name / "checkpoints"
        self.job = ""

    def submit(self) -> None:
        """Start it, or start it again."""
        self.job = self.cluster.submit(self.line, FREEMESH_HOME=str(self.home), RAY_JOB_STOP_WAIT_TIME_S="60")

    def steps(self) -> int:
        """Env steps of the newest checkpoint."""
        found = checkpoint.found(self.checkpoints)
        return int(found[0].name.removeprefix("step_")) if found else 0

    def until_beyond(self, steps: int) -> int:
        """Wait for a checkpoint later than ``steps``; its steps."""
        until(lambda: self.steps() > steps, 120, self.log)
        return self.steps()

    def log(self) -> str:
        """What the job has printed, and what is the matter with the cluster if nothing."""
        return self.cluster.logs(self.job) or self.cluster.trouble()

    def goes_on_from(self) -> int:
        """Env steps that the job, submitted again, says that it goes on from."""
        until(lambda: "going on from" in self.cluster.logs(self.job), 120, self.log)
        (found,) = re.findall(r"going on from \S+ \(([\d,]+) steps", self.cluster.logs(self.job))
        return int(found.replace(",", ""))

    def stop(self) -> None:
        """Stop the job as a user does; it saves a checkpoint and ends."""
        before = self.steps()
        self.cluster.stop(self.job)
        assert self.cluster.finish(self.job) == "STOPPED"
        said = self.cluster.logs(self.job)
        (at,) = re.findall(r"interrupted at ([\d,]+) steps; saved", said)
        assert self.steps() == int(at.replace(",", "")) > before
        assert "Traceback" not in said


@pytest.fixture
def training(cluster: Cluster, tmp_path: Path, request: pytest.FixtureRequest) -> Training:
    return Training(cluster, tmp_path, re.sub(r"\W", "-", request.node.name)[:30])


def test_a_worker_node_that_dies_costs_its_env_runners_until_they_are_elsewhere(training: Training) -> None:
    cluster = training.cluster
    training.submit()
    training.until_beyond(0)
    runners = cluster.actors(RUNNER)
    assert sum(map(len, runners.values())) == 2
    doomed = next(iter(runners))
    cluster.kill_worker(int(doomed.removeprefix("worker-")))
    began = time.monotonic()
    until(lambda: "its process died" in cluster.logs(training.job), 120, training.log)
    at = training.steps()
    training.until_beyond(at)

    def replaced() -> bool:
        now = cluster.actors(RUNNER)
        return doomed not in now and sum(map(len, now.values())) == 2

    until(replaced, 180, training.log)
    print(f"{time.monotonic() - began:.0f} s until both env runners are on the other node")
    training.until_beyond(training.steps())
    assert "going back" not in cluster.logs(training.job)
    training.stop()
    cluster.add_worker()


def test_a_driver_that_is_killed_is_a_failed_job_and_the_same_line_goes_on(training: Training) -> None:
    cluster = training.cluster
    training.submit()
    at = training.until_beyond(0)
    (driver,) = (
        int(place.name)
        for place in Path("/proc").glob("[0-9]*")
        if command(place)[1:3] == [b"-m", b"freemesh_ray"] and str(training.home).encode() in environ(place)
    )
    os.kill(driver, signal.SIGKILL)
    began = time.monotonic()
    assert cluster.finish(training.job) == "FAILED"
    training.submit()
    assert training.goes_on_from() >= at
    print(f"{time.monotonic() - began:.0f} s until the job, submitted again at once, goes on")
    training.until_beyond(training.steps())
    training.stop()


def test_a_head_that_dies_takes_the_job_along_and_the_same_line_goes_on(training: Training) -> None:
    cluster = training.cluster
    training.submit()
    at = training.until_beyond(0)
    cluster.kill_head()
    began = time.monotonic()
    assert cluster.nodes() == {}
    cluster.start_head()
    until(lambda: len(cluster.nodes()) == 3, 120, cluster.trouble)
    print(f"{time.monotonic() - began:.0f} s until the cluster is whole again")
    training.submit()
    assert training.goes_on_from() >= at
    print(f"{time.monotonic() - began:.0f} s until the job, submitted again at once, goes on")
    training.until_beyond(training.steps())
    training.stop()


def command(place: Path) -> list[bytes]:
    """The words of a process; none if it is gone."""
    try:
        return (place / "cmdline").read_bytes().split(b"\0")
    except OSError:
        return []


def environ(place: Path) -> bytes:
    """The environment of a process; empty if it is gone."""
    try:
        return (place / "environ").read_bytes()
    except OSError:
        return b""
