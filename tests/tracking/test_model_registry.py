"""Policies in the model registry: registered once, loaded in fresh processes, served."""

from __future__ import annotations

import json
import math
import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from processes import QUIET, ROOT, Server, free_port, post

from freemesh_ray.policies.policy import DEFAULT, SHIPPED, PolicyError
from freemesh_ray.tracking import MLflowRun, TrackingError, mlflow_store, register, sync

pytestmark = pytest.mark.slow

REFUSING = "http://127.0.0.1:9"
#: A square of side 4 with 16 boundary vertices, as GeoJSON.
SIDE = (
    [(i, 0) for i in range(4)]
    + [(4, i) for i in range(4)]
    + [(4 - i, 4) for i in range(4)]
    + [(0, 4 - i) for i in range(4)]
)
SQUARE = json.dumps({"type": "Polygon", "coordinates": [[*SIDE, SIDE[0]]]})
BOW_TIE = json.dumps({"type": "Polygon", "coordinates": [[[0, 0], [2, 2], [2, 0], [0, 2], [0, 0]]]})


@pytest.fixture(scope="module")
def filled(blank_database: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """A store with the model ``mesher``, its version 1 being ``best``."""
    folder = tmp_path_factory.mktemp("registry")
    shutil.copy(blank_database, folder / "mlflow.db")
    uri = f"sqlite:///{folder / 'mlflow.db'}"
    with MLflowRun(folder / "run", uri=uri, experiment="test", name="study") as run:
        run.model(DEFAULT, name="mesher", tags={"study": "s", "algorithm": "sac", "seed": "0"}, description="all quads")
    return uri


@pytest.fixture
def uri(filled: str, tmp_path: Path) -> str:
    """A copy of that store, with its artifacts beside it."""
    shutil.copy(filled.removeprefix("sqlite:///"), tmp_path / "mlflow.db")
    with closing(sqlite3.connect(tmp_path / "mlflow.db")) as database, database:
        database.execute("update experiments set artifact_location = ?", ((tmp_path / "mlartifacts").as_uri(),))
    return f"sqlite:///{tmp_path / 'mlflow.db'}"


def versions(uri: str, name: str = "mesher") -> list[Any]:
    return mlflow_store.connect(uri).search_model_versions(f"name = '{name}'")


def check_square(made: dict[str, Any], elements: int) -> None:
    """An all-quad mesh of the square: its area, convex elements, figures that are finite."""
    vertices, quads = np.array(made["vertices"]), np.array(made["quads"])
    assert quads.shape == (elements, 4)
    a, b, c, d = np.moveaxis(vertices[quads], 1, 0)
    first, second = c - a, d - b
    areas = (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2
    assert areas.min() > 0
    assert areas.sum() == pytest.approx(16)
    assert all(math.isfinite(value) for value in made["quality"].values())
    assert made["quality"]["elements"] == elements


# ---- what is registered ----------------------------------------------------------------------------------------------


def test_a_run_registers_its_policy_as_a_version_with_an_alias(filled: str):
    (version,) = versions(filled)
    client = mlflow_store.connect(filled)
    assert client.get_model_version_by_alias("mesher", "best").version == version.version
    assert {"study": "s", "algorithm": "sac", "seed": "0"}.items() <= version.tags.items()
    assert version.description == "all quads"
    run = client.get_run(version.run_id)
    assert run.info.run_name == "study"
    (output,) = run.outputs.model_outputs
    model = client.get_logged_model(output.model_id)
    assert (str(model.status), model.source_run_id) == ("READY", version.run_id)
    assert json.loads(model.tags["mlflow.modelVersions"]) == [{"name": "mesher", "version": "1"}]
    assert version.source == model.artifact_location


def test_the_same_policy_of_a_run_is_one_version_and_another_takes_the_alias(uri: str):
    run = versions(uri)[0].run_id
    first = register(DEFAULT, uri=uri, name="mesher", run=run)
    assert first == "1"  # that which the run told
    second = register(SHIPPED["dense"], uri=uri, name="mesher", run=run)
    assert second != first
    assert str(mlflow_store.connect(uri).get_model_version_by_alias("mesher", "best").version) == second
    assert register(DEFAULT, uri=uri, name="mesher", run=run, alias="old") == first
    aliases = mlflow_store.connect(uri).get_registered_model("mesher").aliases
    assert {name: str(version) for name, version in aliases.items()} == {"best": second, "old": first}


def test_a_policy_without_a_run_is_registered_once_too(uri: str):
    first = register(DEFAULT, uri=uri, name="lonely")
    assert register(DEFAULT, uri=uri, name="lonely") == first
    assert len(versions(uri, "lonely")) == 1


def test_a_model_told_without_a_store_is_delivered_later_and_once(tmp_path: Path, blank_database: Path):
    shutil.copy(blank_database, tmp_path / "mlflow.db")
    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    policy = Path(shutil.copy(DEFAULT, tmp_path / "policy.npz"))
    with MLflowRun(tmp_path / "run", uri=REFUSING, experiment="test", name="study") as run:
        run.model(policy, name="mesher")
    policy.unlink()  # what was recorded is a copy
    assert sync(tmp_path, uri) == 3
    (version,) = versions(uri)
    (state,) = (tmp_path / "run" / "tracking").glob("*.json")
    state.write_text(json.dumps(json.loads(state.read_text()) | {"sent": 0, "run_id": None}))  # killed before it noted
    assert sync(tmp_path, uri) == 3
    assert [again.source for again in versions(uri)] == [version.source]
    assert len(list((tmp_path / "mlartifacts" / "models").iterdir())) == 1


def test_what_cannot_be_registered_is_one_line(tmp_path: Path, uri: str):
    with pytest.raises(TrackingError, match=rf"^{REFUSING}: cannot be reached \(.*\): start the server"):
        register(DEFAULT, uri=REFUSING, name="mesher")
    with pytest.raises(TrackingError, match=r"mlflow.db: has no run nobody: deliver it first"):
        register(DEFAULT, uri=uri, name="mesher", run="nobody")
    with pytest.raises(TrackingError, match=r"mlflow.db: refuses \(Invalid model name 'a/b'"):
        register(DEFAULT, uri=uri, name="a/b")
    with pytest.raises(PolicyError, match="no such policy file"):
        register(tmp_path / "policy.npz", uri=uri, name="mesher")


def test_a_model_goes_to_the_stores_own_place_alone(filled: str, tmp_path: Path):
    shutil.copy(filled.removeprefix("sqlite:///"), tmp_path / "mlflow.db")  # its artifacts lie where it was
    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    before = sorted(Path(filled.removeprefix("sqlite:///")).parent.rglob("*"))
    with pytest.raises(TrackingError, match=r"another place: where it was moved set another tracking\.experiment"):
        register(SHIPPED["dense"], uri=uri, name="mesher", run=versions(uri)[0].run_id)
    assert sorted(Path(filled.removeprefix("sqlite:///")).parent.rglob("*")) == before


def test_a_model_that_cannot_be_registered_does_not_hold_up_its_run(tmp_path: Path, uri: str, caplog: Any):
    with MLflowRun(tmp_path / "run", uri=uri, experiment="test", name="study") as run:
        run.model(tmp_path / "absent.npz", name="mesher")
        run.model(DEFAULT, name="a/b")
        run.model(SHIPPED["dense"], name="mesher")
    assert "a model was not recorded" in caplog.text
    assert "the store refused a model" in caplog.text
    assert len(versions(uri)) == 2


# ---- what it does ----------------------------------------------------------------------------------------------------

LOAD = """
import json, sys
import mlflow
model = mlflow.pyfunc.load_model("models:/mesher@best")
made = model.predict([{"geojson": sys.argv[1]}, {"geojson": sys.argv[1], "edge_length": 0.5}])
try:
    model.predict([{"geojson": sys.argv[1]}, {"geojson": sys.argv[2]}])
except mlflow.exceptions.MlflowException as error:
    print(json.dumps([made, str(error), sorted({"ray", "torch"} & set(sys.modules))]))
"""


def test_a_fresh_process_loads_it_without_ray_or_torch_and_meshes(filled: str, tmp_path: Path):
    done = subprocess.run(
        [sys.executable, "-c", LOAD, SQUARE, BOW_TIE], check=True, capture_output=True, text=True, cwd=ROOT,
        env={"PATH": "/usr/bin:/bin", "HOME": str(tmp_path), "MLFLOW_TRACKING_URI": filled, **QUIET},
    )  # fmt: skip
    (plain, fine), error, heavy = json.loads(done.stdout.splitlines()[-1])
    check_square(plain, 16)
    check_square(fine, 64)
    assert error.startswith("row 1: ")
    assert heavy == []


def test_it_is_served_and_refuses_a_bad_polygon(filled: str, tmp_path: Path):
    port = free_port()
    arguments = ["-m", "mlflow", "models", "serve", "-m", "models:/mesher@best", "--env-manager", "local"]
    place = ["--host", "127.0.0.1", "--port", str(port)]
    with Server([*arguments, *place], port, "/ping", tmp_path / "log", MLFLOW_TRACKING_URI=filled, **QUIET) as server:
        for body in ({"dataframe_records": [{"geojson": SQUARE}]}, {"inputs": [{"geojson": SQUARE}]}):
            status, text = post(f"{server.url}/invocations", json.dumps(body).encode())
            assert status == 200
            (made,) = json.loads(text)["predictions"]
            check_square(made, 16)
        for bad in (BOW_TIE, "{}", "[]", "nonsense", "null"):
            body = {"dataframe_records": [{"geojson": bad}]}
            status, text = post(f"{server.url}/invocations", json.dumps(body).encode())
            answer = json.loads(text)
            assert status == 400
            assert "row 0: " in answer["message"]
            assert "stack_trace" not in answer
        assert post(f"{server.url}/invocations", b'{"dataframe_records": [{"polygon": "x"}]}')[0] == 400
