"""What a study's run tells of all its trials: against a real sqlite store, at the study's end and by a later report."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from freemesh_ray.api.study_description import told
from freemesh_ray.cli.command import main
from freemesh_ray.policies.evaluation import RETURN
from freemesh_ray.report.overview import summary
from freemesh_ray.report.results import read
from freemesh_ray.report.variants import variant_results
from freemesh_ray.tracking import MLflowRun, charts, mlflow_store, summarise, sync
from freemesh_ray.tracking.events import parsed
from freemesh_ray.tracking.journal import latest
from freemesh_ray.tracking.study_run import record
from freemesh_ray.tracking.uploader import Uploader, fitted
from tests.recorded_study import ALGORITHMS, algorithms, rows, write_study

pytestmark = pytest.mark.slow

EXPECTS = ["SAC > PPO", "SAC = TD3"]
AWAY = "http://127.0.0.1:9"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a study of four variants and three seeds."""
    folder = tmp_path_factory.mktemp("recorded") / "algorithms"
    sets = {"TD3": {"env.upsilon": 0.5}}
    return algorithms(folder, expects=EXPECTS, steps=100_000, sets=sets)


@pytest.fixture
def folder(recorded: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(recorded, tmp_path / "studies" / "algorithms"))


@pytest.fixture
def uri(blank_database: Path, tmp_path: Path) -> str:
    shutil.copy(blank_database, tmp_path / "mlflow.db")
    return f"sqlite:///{tmp_path / 'mlflow.db'}"


def ended(folder: Path, uri: str) -> MLflowRun:
    """A study's run that was described at its end."""
    with MLflowRun(folder, uri=uri, experiment="test", name="algorithms", flush_seconds=60) as run:
        run.summarise(told(summary(folder), "algorithms"))
    return run


def reported(folder: Path, uri: str, experiment: str = "test") -> str | None:
    """A later report; the study's page."""
    found = told(summary(folder), "algorithms")
    return summarise(folder, found, uri=uri, experiment=experiment, below="report")


def runs(uri: str) -> dict[str, Any]:
    """Name -> run of those that are not deleted; every name once."""
    client = mlflow_store.connect(uri)
    experiments = [experiment.experiment_id for experiment in client.search_experiments()]
    found = list(client.search_runs(experiments))
    assert len({run.info.run_name for run in found}) == len(found)
    return {run.info.run_name: run for run in found}


def curve(uri: str, run: Any, name: str) -> list[tuple[int, float]]:
    history = mlflow_store.connect(uri).get_metric_history(run.info.run_id, name)
    return sorted((point.step, point.value) for point in history)


def ids(found: Mapping[str, Any]) -> dict[str, str]:
    return {name: run.info.run_id for name, run in found.items()}


def lengthen(folder: Path, name: str) -> None:
    """One more evaluation of a trial, with another return than before."""
    evaluations = folder / "runs" / name / "evaluations.jsonl"
    last = json.loads(evaluations.read_text().splitlines()[-1])
    last |= {"env_steps": last["env_steps"] + 10_000, RETURN: last[RETURN] + 5.0}
    with evaluations.open("a") as file:
        file.write(json.dumps(last) + "\n")


# ---- what is told ----------------------------------------------------------------------------------------------------


def test_the_description_has_what_it_is_the_verdicts_the_final_table_and_how_to_run_it_again(folder: Path, uri: str):
    run = ended(folder, uri)
    text = runs(uri)["algorithms"].data.tags["mlflow.note.content"]
    assert "# Learning efficiency of four algorithms" in text
    for expected in EXPECTS:
        assert re.search(rf"^\| *{re.escape(expected)} *\|", text, re.MULTILINE)
    for label in ALGORITHMS:
        assert re.search(rf"^\| *{label} *\| *3 of 3 *\|", text, re.MULTILINE)
    assert "freemesh study algorithms.yaml" in text
    assert f"(#/experiments/1/runs/{run.run_id}/artifacts/report/report.html)" in text
    assert f"({run.page})" in text


def test_the_figures_and_curves_are_those_of_the_report(folder: Path, uri: str):
    ended(folder, uri)
    found = runs(uri)
    for variant in variant_results(read(folder)):
        own = found[variant.label]
        mean = sum(variant.finals[RETURN]) / 3
        assert own.data.metrics["final/return"] == pytest.approx(mean)
        assert found["algorithms"].data.metrics[f"final/return/{variant.label}"] == pytest.approx(mean)
        band = variant.bands[RETURN]
        for end, line in (("", band.iqm.value), ("_low", band.iqm.low), ("_high", band.iqm.high)):
            points = list(zip(band.steps.astype(int).tolist(), line.tolist(), strict=True))
            assert curve(uri, own, f"iqm/return{end}") == points


def test_a_variants_run_is_below_the_study_with_what_it_sets(folder: Path, uri: str):
    run = ended(folder, uri)
    found = runs(uri)
    assert set(found) == {"algorithms", *ALGORITHMS}
    colours = set()
    for label in ALGORITHMS:
        data = found[label].data
        assert data.tags["mlflow.parentRunId"] == run.run_id
        assert {"study": "algorithms", "variant": label, "freemesh.sums_up": run.id}.items() <= data.tags.items()
        colours.add(data.tags["mlflow.runColor"])
        assert found[label].info.status == "FINISHED"
    assert len(colours) == len(ALGORITHMS)
    assert found["TD3"].data.params == {"variant": "TD3", "env.upsilon": "0.5"}
    assert found["SAC"].data.params == {"variant": "SAC"}


def test_the_view_draws_what_the_runs_have(folder: Path, uri: str):
    run = ended(folder, uri)
    experiment = mlflow_store.connect(uri).get_experiment_by_name("test")
    view = json.loads(experiment.tags[f"{charts.VIEW}{charts.key(str(run.run_id))}"])
    assert run.page == charts.study_page(experiment.experiment_id, str(run.run_id))
    assert view["searchFilter"] == f"tags.`mlflow.parentRunId` = '{run.run_id}'"
    sections = [section["uuid"] for section in view["compareRunSections"]]
    assert sections[:3] == ["curves", "seeds", "finals"]
    own = set(runs(uri)["SAC"].data.metrics)
    trial = set(rows(np.ones(1), np.ones(1))[0])
    for chart in view["compareRunCharts"]:
        known = trial if chart["metricSectionId"] == "seeds" else own
        assert set(chart["selectedMetricKeys"]) <= known
        assert chart["metricSectionId"] in sections
    first = view["compareRunCharts"][0]
    assert (first["type"], first["selectedMetricKeys"]) == ("LINE", ["iqm/return", "iqm/return_low", "iqm/return_high"])


# ---- told again ------------------------------------------------------------------------------------------------------


def test_the_same_report_again_changes_nothing(folder: Path, uri: str):
    run = ended(folder, uri)
    before = runs(uri)
    assert reported(folder, uri) == run.page
    after = runs(uri)
    assert ids(after) == ids(before)
    assert after["algorithms"].data.metrics == before["algorithms"].data.metrics
    assert after["algorithms"].info.status == "FINISHED"
    for label in ALGORITHMS:
        assert curve(uri, after[label], "iqm/return") == curve(uri, before[label], "iqm/return")
        assert len(curve(uri, after["algorithms"], f"final/return/{label}")) == 1
    with MLflowRun(folder, uri=uri, experiment="test", name="algorithms", resume=True, flush_seconds=60) as again:
        again.summarise(told(summary(folder), "algorithms"))
    assert again.page == run.page
    assert ids(runs(uri)) == ids(before)
    assert len(curve(uri, after["algorithms"], "final/return/SAC")) == 1


def test_another_result_replaces_the_runs_of_the_variants_that_it_changes(folder: Path, uri: str):
    ended(folder, uri)
    before, original = runs(uri), (folder / "runs" / "SAC-356" / "evaluations.jsonl").read_text()
    lengthen(folder, "SAC-356")
    assert reported(folder, uri)
    after = runs(uri)
    changed = {name for name in after if ids(after)[name] != ids(before)[name]}
    assert changed == {"SAC"}
    steps = [step for step, _ in curve(uri, after["SAC"], "iqm/return")]
    assert len(set(steps)) == len(steps)
    figure = "final/return/SAC"
    assert after["algorithms"].data.metrics[figure] > before["algorithms"].data.metrics[figure]
    (folder / "runs" / "SAC-356" / "evaluations.jsonl").write_text(original)
    assert reported(folder, uri)
    again = runs(uri)
    assert curve(uri, again["SAC"], "iqm/return") == curve(uri, before["SAC"], "iqm/return")


def test_a_run_that_was_delivered_before_is_deleted_by_the_same_process(folder: Path, uri: str):
    ended(folder, uri)
    before = runs(uri)
    lengthen(folder, "SAC-356")
    journal = latest(folder)
    assert journal is not None
    uploader = Uploader(journal, uri, "test")
    uploader.deliver_shared()
    record(journal, told(summary(folder), "algorithms"))
    uploader.deliver_shared()
    journal.release()
    assert {name for name, run in ids(runs(uri)).items() if run != ids(before)[name]} == {"SAC"}


def test_a_study_that_ended_otherwise_stays_as_it_ended(folder: Path, uri: str):
    with pytest.raises(KeyboardInterrupt), MLflowRun(folder, uri=uri, experiment="test", name="algorithms"):
        raise KeyboardInterrupt
    assert reported(folder, uri)
    sync(folder, uri)
    found = runs(uri)
    assert found["algorithms"].info.status == "KILLED"
    assert "mlflow.note.content" in found["algorithms"].data.tags
    assert set(found) == {"algorithms", *ALGORITHMS}


def test_a_study_at_work_is_left_alone(folder: Path, uri: str, monkeypatch: pytest.MonkeyPatch, caplog: Any):
    monkeypatch.setattr("freemesh_ray.tracking.journal.PATIENCE_SECONDS", 0.1)
    with MLflowRun(folder, uri=uri, experiment="test", name="algorithms"):
        assert reported(folder, uri) is None
    assert "is at work, and is described in the store when it ends" in caplog.text
    assert set(runs(uri)) == {"algorithms"}


def test_a_study_that_was_never_tracked_is_not_described(folder: Path, uri: str):
    assert reported(folder, uri) is None
    assert not (folder / "tracking").exists()
    assert runs(uri) == {}


def test_what_an_absent_store_missed_is_delivered_later(folder: Path, uri: str, caplog: Any):
    with MLflowRun(folder, uri=AWAY, experiment="test", name="algorithms") as run:
        run.summarise(told(summary(folder), "algorithms"))
    assert run.page is None
    assert reported(folder, AWAY) is None
    assert "freemesh sync" in caplog.text
    sync(folder, uri)
    found = runs(uri)
    assert set(found) == {"algorithms", *ALGORITHMS}
    assert found["algorithms"].info.status == "FINISHED"
    assert "mlflow.note.content" in found["algorithms"].data.tags


def test_a_study_of_another_store_is_not_sent_to_this_one(folder: Path, uri: str, caplog: Any):
    ended(folder, uri)
    text = runs(uri)["algorithms"].data.tags["mlflow.note.content"]
    lengthen(folder, "SAC-356")
    assert reported(folder, uri, "other") is None
    assert "another store" in caplog.text
    assert runs(uri)["algorithms"].data.tags["mlflow.note.content"] == text


def test_a_run_that_tracks_nothing_is_described_nowhere(folder: Path, uri: str):
    with MLflowRun(folder, uri=uri, experiment="test", name="algorithms", enabled=False) as run:
        run.summarise(told(summary(folder), "algorithms"))
    assert run.page is None
    assert runs(uri) == {}


# ---- other studies ---------------------------------------------------------------------------------------------------


def test_the_metric_of_a_study_comes_first(recorded: Path, tmp_path: Path):
    folder = Path(shutil.copytree(recorded, tmp_path / "algorithms"))
    text = (folder / "study.yaml").read_text().replace(RETURN, "eval_stochastic/completion_rate")
    (folder / "study.yaml").write_text(text)
    found = summary(folder)
    assert found.curves[0] == "iqm/stochastic_completion_rate"
    assert found.seeds[0] == "eval_stochastic/completion_rate"
    assert found.finals[0] == "final/stochastic_completion_rate"
    for variant in found.variants.values():
        assert {found.curves[0], f"{found.curves[0]}_low", f"{found.curves[0]}_high"} <= set(variant.curves)
        low, high = variant.curves[f"{found.curves[0]}_low"], variant.curves[f"{found.curves[0]}_high"]
        assert all(0.0 <= bottom <= top <= 1.0 for (_, bottom), (_, top) in zip(low, high, strict=True))


def test_a_study_without_evaluations_yet_is_described_without_figures(tmp_path: Path):
    trials = [{"label": "A", "seed": 1, "run": "runs/A-1", "status": "pending", "error": None, "settings": {}}]
    folder = write_study(tmp_path / "new", {"title": "Nothing yet", "variants": {"A": {}}, "seeds": [1]}, trials)
    found = summary(folder)
    assert found.variants["A"].curves == {}
    assert found.figures == {"final/seeds/A": 0}
    assert "Not finished yet" in found.text


# ---- parts -----------------------------------------------------------------------------------------------------------


@given(st.text(st.characters(codec="utf-8"), max_size=300), st.integers(40, 200))
def test_a_text_is_cut_at_a_line(text: str, room: int):
    cut = fitted(text, room)
    assert len(cut) <= room or len(text) > room
    if len(text) <= room:
        assert cut == text
    else:
        begun = cut.removesuffix("\n\n(The report has the rest.)")
        assert begun != cut
        assert text.startswith(begun)
        assert len(cut) <= room


@pytest.mark.parametrize("change", [
    {"charts": {"curves": ["x"] * 31}}, {"charts": {"other": []}}, {"charts": {"curves": [1]}}, {"charts": []},
    {"charts": {"seeds": ["x" * 251]}}, {"text": "x" * 20_001}, {"values": {"x": "y"}}, {"step": 1.5},
])  # fmt: skip
def test_what_is_no_summary_is_no_event(change: dict[str, Any]):
    sound = {"kind": "summary", "time": 1, "step": 1, "text": "", "values": {"x": 1.0}, "charts": {"curves": ["x"]}}
    assert parsed(json.dumps(sound).encode()) == sound
    assert parsed(json.dumps(sound | change).encode()) == {}


def test_a_page_needs_no_quoting(folder: Path, uri: str):
    page = str(ended(folder, uri).page)
    assert re.fullmatch(r"[\w#/?&=-]+", page)


def test_the_command_reports_to_the_store_that_the_study_was_tracked_to(
    folder: Path, uri: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setenv("FREEMESH_HOME", str(folder.parents[1]))
    monkeypatch.setenv("MLFLOW_TRACKING_URI", uri)
    with MLflowRun(folder, uri=uri, experiment="freemesh", name="algorithms", flush_seconds=60):
        pass
    assert main(["report", "algorithms", "--episodes", "1"]) == 0
    *_, command, address = capsys.readouterr().err.splitlines()
    assert command.endswith("mlflow.db")
    experiment = mlflow_store.connect(uri).get_experiment_by_name("freemesh").experiment_id
    found = runs(uri)
    page = charts.study_page(experiment, found["algorithms"].info.run_id)
    assert address == f"http://127.0.0.1:5000/{page}"
    assert set(found) == {"algorithms", *ALGORITHMS}
    report = Path(found["algorithms"].info.artifact_uri.removeprefix("file://")) / "report" / "report.html"
    assert report.read_bytes() == (folder / "report" / "report.html").read_bytes()
