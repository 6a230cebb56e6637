"""What all tests share: one hypothesis profile, the same examples on every machine, and one MLflow server."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings
from processes import Server, mlflow_server

from freemesh_ray.tracking import mlflow_store

settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.load_profile("repeatable")


@pytest.fixture(scope="session")
def blank_database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An MLflow database without runs; to copy it is much faster than to make one."""
    path = tmp_path_factory.mktemp("store") / "mlflow.db"
    mlflow_store.connect(f"sqlite:///{path}")
    return path


@pytest.fixture(scope="session")
def served_store(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A real ``mlflow server`` with a store of its own; who kills it starts it again."""
    with mlflow_server(tmp_path_factory.mktemp("server")) as server:
        yield server
