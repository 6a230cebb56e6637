"""``freemesh submit`` without a cluster: the line that it builds, what it refuses, and how much would be uploaded."""

from __future__ import annotations

import json
import logging
import random
import shlex
import shutil
import subprocess
import threading
import zipfile
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import pytest
import yaml
from plugged import modules
from processes import ROOT, free_port
from ray._private.runtime_env import packaging

from envs.errors import BAD_INPUT, INTERRUPTED
from freemesh_ray.cli import command, submit
from freemesh_ray.ray_jobs import job_server
from freemesh_ray.ray_jobs.submit_line import RUNTIME_ENV, runtime_env, submission
from freemesh_ray.tracking import provenance

#: Bytes of a job's code, packed.
SMALL = 3_000_000


@pytest.fixture(autouse=True)
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that looks like a checkout, and an environment that says nothing."""
    for variable in (
        *job_server.ADDRESSES,
        "RAY_AUTH_TOKEN",
        "RAY_AUTH_TOKEN_PATH",
        "FREEMESH_HOME",
        "MLFLOW_TRACKING_URI",
    ):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "user"))
    folder = tmp_path / "checkout"
    (folder / "freemesh_ray").mkdir(parents=True)
    shutil.copytree(ROOT / "deploy", folder / "deploy")
    monkeypatch.chdir(folder)
    return folder


def printed(capsys: pytest.CaptureFixture[str], *arguments: str) -> list[str]:
    """The arguments of the line that ``--print`` shows."""
    assert command.main(["submit", "--print", *arguments]) == 0
    return shlex.split(capsys.readouterr().out)


def value(line: list[str], option: str) -> str:
    return line[line.index(option) + 1]


def variables(line: list[str]) -> dict[str, str]:
    return json.loads(value(line, "--runtime-env-json"))["env_vars"]


def test_the_line_carries_configuration_and_overrides_and_goes_on(capsys: pytest.CaptureFixture[str]) -> None:
    asked = ["train", "--config", "train_smoke", "--set", "curriculum.stages=[T1, T2]"]
    line = printed(capsys, "--", *asked)
    assert line[:3] == ["ray", "job", "submit"]
    assert line[line.index("--") :] == ["--", "python", "-m", "freemesh_ray", *asked, "--resume"]
    assert value(line, "--working-dir") == "."
    assert value(line, "--address") == job_server.DEFAULT
    assert value(line, "--entrypoint-num-cpus") == "1"
    assert "--submission-id" not in line, "the line can be run again"
    assert printed(capsys, "--", *asked, "--resume") == line


def test_a_study_leaves_the_cores_to_its_trials(capsys: pytest.CaptureFixture[str]) -> None:
    assert value(printed(capsys, "--", "study", "algorithms", "--smoke"), "--entrypoint-num-cpus") == "0"
    assert value(printed(capsys, "--cpus", "2", "--", "study", "algorithms"), "--entrypoint-num-cpus") == "2"


def test_the_runtime_environment_is_the_declared_one_and_says_where_things_lie(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    declared = yaml.safe_load((ROOT / RUNTIME_ENV).read_text())
    assert int(declared["env_vars"]["RAY_JOB_STOP_WAIT_TIME_S"]) >= 60
    monkeypatch.setattr(provenance, "_commit", lambda: "c" * 40)
    monkeypatch.setattr(provenance, "_git", lambda *arguments: "")
    line = printed(capsys, "--home", "/shared", "--tracking", "http://mlflow:5000", "--", "train")
    assert json.loads(value(line, "--runtime-env-json"))["excludes"] == declared["excludes"]
    ours = {"FREEMESH_HOME": "/shared", "MLFLOW_TRACKING_URI": "http://mlflow:5000", "FREEMESH_COMMIT": "c" * 40}
    assert variables(line) == declared["env_vars"] | ours
    assert not {"FREEMESH_HOME", "MLFLOW_TRACKING_URI"} & set(variables(printed(capsys, "--", "train")))


def test_plug_ins_that_the_checkout_does_not_bring_are_uploaded_beside_it(
    checkout: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    source = "def reward(step): return step.reward\n"
    elsewhere = checkout.parent / "elsewhere"
    places = {
        "plugged_a": checkout / "plugged_a.py",  # goes with the checkout
        "plugged_b": checkout / "mine" / "plugged_b.py",  # beside the settings
        "plugged_c": elsewhere / "plugged_c.py",
        "plugged_d": elsewhere / "plugged_d" / "__init__.py",
        "plugged_e": checkout / "plugged_e.py",  # ignored
    }
    for place in places.values():
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(source)
    (checkout / "mine" / "own.yaml").write_text("name: own\n")
    subprocess.run(["git", "init", "--quiet"], cwd=checkout, check=True)
    (checkout / ".gitignore").write_text("plugged_e.py\n")
    monkeypatch.syspath_prepend(str(elsewhere))
    beside = {}
    with modules(elsewhere):
        for name in places:
            line = printed(capsys, "--", "train", "--config", "mine/own.yaml", "--set", f"env.reward={name}:reward")
            beside[name] = json.loads(value(line, "--runtime-env-json")).get("py_modules", [])
        assert command.main(["submit", "--print", "--", "train", "--set", "env.reward=plugged_f:reward"]) == 2
        assert "env.reward: plugged_f:reward: no module plugged_f: put plugged_f.py into" in capsys.readouterr().err
    assert beside.pop("plugged_a") == []
    for name, (place,) in beside.items():  # Ray takes no files: they are packages
        assert Path(place).name == name
        assert (Path(place) / "__init__.py").read_text() == source
    assert Path(*beside["plugged_d"]) == (elsewhere / "plugged_d").resolve()


def test_every_variable_is_text(tmp_path: Path) -> None:
    """Ray takes nothing else; the file's are, and ours win over them."""
    assert all(isinstance(text, str) for text in runtime_env(ROOT / RUNTIME_ENV, {})["env_vars"].values())
    assert runtime_env(ROOT / RUNTIME_ENV, {"OMP_NUM_THREADS": "4"})["env_vars"]["OMP_NUM_THREADS"] == "4"


def test_a_job_that_is_named_and_not_followed() -> None:
    line = submission("http://head:8265", ["train"], {}, cpus=1, submission_id="mine", wait=False)
    assert value(line, "--submission-id") == "mine"
    assert "--no-wait" in line[: line.index("--")]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "-- train"),
        (["--", "mesh", "T1"], "-- train"),
        (["--", "train", "--set", "lerner.gamma=0.9"], "did you mean learner.gamma?"),
        (["--", "train", "--set", "curriculum.stages=[T1, t1]"], "T1"),
        (["--", "train", "--bad"], "--bad"),
        (["--", "study"], "study's name"),
        (["--", "study", "nothing"], "nothing"),
        (["--", "study", "algorithms", "--set", "seed=1"], "seed"),
        (["--", "study", "../mine.yaml"], "outside the folder that is uploaded"),
        (["--cpus", "-1", "--", "train"], "--cpus"),
        (["--home", "s3://bucket/home", "--", "train"], "--home: the home: must be a folder, not a URL"),
        (["--address", "ray://head:10001", "--", "train"], "http://HEAD:8265"),
    ],
)
def test_what_is_wrong_is_told_before_anything_is_uploaded(
    arguments: list[str], words: str, checkout: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = {"study": {"title": "Mine", "seeds": [1], "variants": {"one": None}}}
    (checkout.parent / "mine.yaml").write_text(yaml.safe_dump(study))
    try:
        code = command.main(["submit", *arguments])
    except SystemExit as exit_:
        code = exit_.code
    out, err = capsys.readouterr()
    assert (code, out, err.count("\n")) == (2, "", 1), err
    assert words in err


def test_elsewhere_than_in_a_checkout_there_is_nothing_to_upload(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert command.main(["submit", "--", "train"]) == 2
    assert f"{tmp_path}: is no checkout" in capsys.readouterr().err


def test_a_cluster_that_is_not_there_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    url = f"http://127.0.0.1:{free_port()}"
    assert command.main(["submit", "--address", url, "--", "train"]) == 2
    out, err = capsys.readouterr()
    assert out.startswith("ray job submit")
    assert err.startswith(f"freemesh: {url}: cannot be reached")
    assert err.count("\n") == 1


def test_who_stops_following_is_told_how_to_stop_the_job(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ran: list[list[str]] = []

    def follow(line: list[str]) -> None:
        ran.append(line)
        raise KeyboardInterrupt

    monkeypatch.setattr(job_server, "submitted", lambda url: set())
    monkeypatch.setattr(submit, "follow", follow)
    assert command.main(["submit", "--address", "http://head:8265", "--", "train"]) == INTERRUPTED
    out, err = capsys.readouterr()
    assert ran == [shlex.split(out)], "what is run is what is printed"
    job = value(ran[0], "--submission-id")
    assert job.startswith("train-main-")
    assert f"the job goes on: `ray job logs --address http://head:8265 {job} --follow`" in err
    assert f"`ray job stop --address http://head:8265 {job}` ends it" in err


@pytest.fixture
def dashboard() -> Iterator[str]:
    """A server that lists one job, called "it's mine"."""

    class Answers(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.end_headers()
            self.wfile.write(json.dumps([{"submission_id": "it's mine"}, {"submission_id": None}]).encode())

        def log_message(self, *arguments: object) -> None:
            pass

    with HTTPServer(("127.0.0.1", 0), Answers) as served:
        threading.Thread(target=served.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{served.server_port}"
        served.shutdown()


def test_an_id_that_was_used_before_is_one_line(dashboard: str, capsys: pytest.CaptureFixture[str]) -> None:
    line = ["submit", "--address", dashboard, "--submission-id", "it's mine", "--", "train"]
    assert command.main(line) == BAD_INPUT
    err = capsys.readouterr().err
    assert err.startswith("freemesh: it's mine: a job was submitted under this id before: give another")
    assert err.count("\n") == 1
    (fix,) = err.split("`")[1::2]
    assert shlex.split(fix) == ["ray", "job", "delete", "--address", dashboard, "it's mine"]


def test_a_checkout_that_is_too_large_to_upload_is_one_line(
    dashboard: str, checkout: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(packaging, "GCS_STORAGE_MAX_SIZE", 2**20)
    monkeypatch.setattr(submit, "follow", lambda line: 0)
    line = ["submit", "--address", dashboard, "--", "train"]
    assert command.main(line) == 0
    (checkout / "old").mkdir()
    (checkout / "old" / "results.bin").write_bytes(random.Random(0).randbytes(2**21))
    assert command.main(line) == BAD_INPUT
    err = capsys.readouterr().err
    assert err.startswith(f"freemesh: {checkout}: would upload 2 MiB, Ray takes 1: name old/results.bin (2 MiB) in ")
    assert err.count("\n") == 1
    (checkout / ".gitignore").write_text("old/results.bin\n")
    assert command.main(line) == 0


def test_address_and_token_are_found_where_ray_finds_them(tmp_path: Path) -> None:
    both = {"RAY_ADDRESS": "http://second:1", "RAY_API_SERVER_ADDRESS": "https://first/"}
    assert job_server.address(None, both) == "https://first"
    assert job_server.address(None, {"RAY_ADDRESS": "http://second:1"}) == "http://second:1"
    assert job_server.address("http://given:1", both) == "http://given:1"
    (tmp_path / "token").write_text("secret\n")
    assert job_server.token({"RAY_AUTH_TOKEN_PATH": str(tmp_path / "token")}) == "secret"
    assert job_server.token({"RAY_AUTH_TOKEN": "own", "RAY_AUTH_TOKEN_PATH": str(tmp_path / "token")}) == "own"
    assert job_server.token({}) == ""
    (tmp_path / "user" / ".ray").mkdir(parents=True)
    (tmp_path / "user" / ".ray" / "auth_token").write_text("mine")
    assert job_server.token({}) == "mine"


def test_the_upload_is_small_and_has_all_that_a_job_needs(tmp_path: Path) -> None:
    """Packed by Ray itself, which leaves out what .gitignore names."""
    excludes = yaml.safe_load((ROOT / RUNTIME_ENV).read_text())["excludes"]
    package = tmp_path / "package.zip"
    packaging.create_package(str(ROOT), package, True, excludes=excludes, logger=logging.getLogger("quiet"))
    names = zipfile.ZipFile(package).namelist()
    folders = {name.split("/")[0] for name in names}
    assert {"envs", "freemesh_ray", "tune_configs"} <= folders
    assert not {".git", "docs", "tests", "runs", "studies"} & folders
    assert {
        "tune_configs/defaults.yaml",
        "envs/domains/catalogue/T1.json",
        "freemesh_ray/ray_jobs/submit_line.py",
    } <= set(names)
    assert not [name for name in names if "__pycache__" in name or name.endswith(".npz")]
    assert {str(path.relative_to(ROOT)) for path in (ROOT / "freemesh_ray").rglob("*.py")} <= set(names)
    assert package.stat().st_size < SMALL


def test_a_copy_without_its_history_says_the_given_commit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FREEMESH_COMMIT", "c" * 40 + "-dirty")
    monkeypatch.setattr(provenance, "_commit", lambda: "")
    assert provenance.provenance()[provenance.COMMIT] == "c" * 40 + "-dirty"
    monkeypatch.setattr(provenance, "_commit", lambda: "d" * 40)
    assert provenance.provenance()[provenance.COMMIT].startswith("d" * 40)
