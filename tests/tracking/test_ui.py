"""A study as MLflow's own pages show it, in a real browser: runs below their study, chosen, compared, overlaid."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

import pytest
from browser import CHROMIUM, Browser
from mlflow_page import close_assistant, keep
from processes import Server

from freemesh_ray.tracking import MLflowRun, mlflow_store

pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium")]

NAMES = sorted(f"{label}-{seed}" for label in ("R1", "R2") for seed in range(3))
STEPS = range(0, 50_001, 2_500)
METRIC = "eval_deterministic/return"
#: The links of the runs in the table.
LINKS = f"[...document.querySelectorAll('.ag-row a')].filter(a => {json.dumps(NAMES)}.includes(a.innerText))"
#: The drawn chart of the metric: its curves' names, points, last step, and whether each has a line on the page.
CHART = f"""[...document.querySelectorAll('.js-plotly-plot')].map(plot => ({{
    curves: plot.data.filter(curve => curve.x && curve.x.length > 1).map(curve => [
        curve.name, curve.x.length, curve.x[curve.x.length - 1]]),
    drawn: [...plot.querySelectorAll('.scatterlayer .trace path.js-line')].filter(
        path => path.getAttribute('d').length > 50).length,
}})).find(chart => chart.drawn >= {len(NAMES)})"""


def value(name: str, step: int) -> float:
    """A curve of its own for every run."""
    return 10 * (1 - math.exp(-step / (20_000 if name < "R2" else 12_000))) - int(name[-1])


@pytest.fixture(scope="module")
def study(served_store: Server, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The id of the experiment that holds a study and its six trials."""
    folder = tmp_path_factory.mktemp("study")
    here = {"uri": served_store.url, "experiment": "compared", "flush_seconds": 60}
    with MLflowRun(folder, name="radius", tags={"study": "radius"}, **here) as parent:
        for name in NAMES:
            label, seed = name.split("-")
            tags = {"study": "radius", "variant": label, "domain": "T1", "algorithm": "sac", "seed": seed}
            params = {"env.radius": label, "seed": seed}
            assert parent.wait(60)
            with MLflowRun(folder / name, name=name, params=params, tags=tags, parent=parent.id, **here) as trial:
                for step in STEPS:
                    trial.metrics({METRIC: value(name, step), "train/critic_loss": 1 / (1 + step)}, step)
    return mlflow_store.connect(served_store.url).get_experiment_by_name("compared").experiment_id


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Browser]:
    with Browser(tmp_path / "profile") as page:
        yield page


def expand(browser: Browser) -> None:
    """Show the trials below their study."""
    button = "[...document.querySelectorAll('.ag-row a')].find(a => a.innerText == 'radius')?.closest('.ag-row')"
    browser.wait_for(f"{button}?.querySelector('button')")
    assert browser.evaluate(f"{LINKS}.length") == 0
    browser.evaluate(f"{button}.querySelector('button').click()")
    browser.wait_for(f"{LINKS}.length == {len(NAMES)}")


def test_trials_are_below_their_study_and_those_chosen_are_compared(
    served_store: Server, study: str, browser: Browser, tmp_path: Path
):
    browser.open(f"{served_store.url}/#/experiments/{study}/runs")
    expand(browser)
    browser.evaluate(f"{LINKS}.map(a => a.closest('.ag-row').querySelector('input')).forEach(box => box.click())")
    compare = (
        "[...document.querySelectorAll('button')].find(button => button.innerText == 'Compare' && !button.disabled)"
    )
    browser.wait_for(compare)
    keep(browser, "runs.png", tmp_path)
    browser.evaluate(f"{compare}.click()")
    browser.wait_for("location.href.includes('compare-runs') && document.querySelector('.js-plotly-plot')")
    browser.wait_for("document.body.innerText.includes('Run details')")
    text = browser.evaluate("document.body.innerText")
    assert "Comparing 6 Runs from 1 Experiment" in text
    for word in (*NAMES, METRIC, "train/critic_loss", "env.radius", "variant", "domain", "algorithm", "seed"):
        assert word in text
    assert "\nradius\n" not in text.split("Run details")[1].split("Parameters")[0]  # the study itself was not chosen


@pytest.mark.parametrize("page", ["charts", "metric"])
def test_the_curves_lie_over_each_other_by_env_steps(
    served_store: Server, study: str, browser: Browser, tmp_path: Path, page: str
):
    if page == "charts":
        browser.open(f"{served_store.url}/#/experiments/{study}/runs?compareRunsMode=CHART")
        expand(browser)
    else:
        client = mlflow_store.connect(served_store.url)
        found = {run.info.run_name: run.info.run_id for run in client.search_runs([study])}
        asked = {
            "runs": [found[name] for name in NAMES], "metric": METRIC, "experiments": [study],
            "plot_metric_keys": [METRIC], "plot_layout": {}, "deselected_curves": [],
        }  # fmt: skip
        query = "&".join(f"{key}={quote(json.dumps(value))}" for key, value in asked.items())
        browser.open(f"{served_store.url}/#/metric?{query}&x_axis=step&y_axis_scale=linear&line_smoothness=1")
    close_assistant(browser)
    browser.wait_for(CHART)
    chart = browser.evaluate(CHART)
    keep(browser, f"{page}.png", tmp_path)
    curves = {name.split(" (")[0]: (points, last) for name, points, last in chart["curves"]}
    assert curves == dict.fromkeys(NAMES, (len(STEPS), STEPS[-1]))
    assert METRIC in browser.evaluate("document.body.innerText")
