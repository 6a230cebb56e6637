"""The page that a study's printed link opens, in a real browser: every variant's curve with its interval, at once."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

import pytest
from browser import CHROMIUM, Browser
from mlflow_page import close_assistant, keep
from processes import Server

from freemesh_ray.api.study_description import told
from freemesh_ray.policies.evaluation import RETURN
from freemesh_ray.report.overview import summary
from freemesh_ray.report.results import read
from freemesh_ray.tracking import MLflowRun, browsing, mlflow_store
from tests.recorded_study import ALGORITHMS, SEEDS, algorithms

pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium")]

#: The charts that are drawn: the runs of their curves, how many have a line, and where they are on the page.
CHARTS = """[...document.querySelectorAll('.js-plotly-plot')].map(plot => ({
    names: plot.data.filter(curve => curve.x && curve.x.length > 1).map(curve => curve.name),
    drawn: [...plot.querySelectorAll('.scatterlayer .trace path.js-line')].filter(
        path => path.getAttribute('d').length > 50).length,
    top: plot.getBoundingClientRect().top,
}))"""
#: Of a mean and both ends of its interval, of each variant.
LINES = 3 * len(ALGORITHMS)


@pytest.fixture(scope="module")
def run(served_store: Server, tmp_path_factory: pytest.TempPathFactory) -> MLflowRun:
    """A study with its trials in a store, described at its end."""
    folder = algorithms(tmp_path_factory.mktemp("study") / "algorithms", expects=["SAC > PPO"])
    here = {"uri": served_store.url, "experiment": "one click", "flush_seconds": 60}
    with MLflowRun(folder, name="algorithms", tags={"study": "algorithms"}, **here) as parent:
        assert parent.wait(60)
        for trial in read(folder).trials:
            name, tags = f"{trial.label}-{trial.seed}", {"study": "algorithms", "variant": trial.label}
            params = {"seed": trial.seed, "learner.gamma": 0.99}
            with MLflowRun(
                folder / "runs" / name, name=name, params=params, tags=tags, parent=parent.id, **here
            ) as child:
                for row in trial.evaluations:
                    child.metrics({"train/stage": 0}, int(row["env_steps"]))
                    child.metrics({key: row[key] for key in row if key.startswith("eval")}, int(row["env_steps"]))
        parent.summarise(told(summary(folder), "algorithms"))
    return parent


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Browser]:
    with Browser(tmp_path / "profile", 1600, 1300) as page:
        yield page


def test_the_link_opens_the_variants_curves(
    served_store: Server, run: MLflowRun, browser: Browser, tmp_path: Path
) -> None:
    (link,) = browsing(served_store.url, run.page)
    browser.open(link)
    close_assistant(browser)
    first = f"{CHARTS}.sort((a, b) => a.top - b.top)[0]"
    browser.wait_for(f"{first}?.drawn >= {LINES}")
    keep(browser, "study_page.png", tmp_path)
    chart = browser.evaluate(first)
    assert set(chart["names"]) == set(ALGORITHMS)
    assert chart["top"] < 500  # to be seen without scrolling
    text = browser.evaluate("document.body.innerText")
    assert text.index("Variants: IQM over seeds") < text.index("Trainings, one line a seed")
    for label in ALGORITHMS:
        for end in ("", "_low", "_high"):
            assert f"{label} (iqm/return{end})" in text


def test_further_down_are_the_trainings_and_no_constants(
    served_store: Server, run: MLflowRun, browser: Browser, tmp_path: Path
) -> None:
    browser.open(browsing(served_store.url, run.page)[0])
    names = {f"{label}-{seed}" for label in ALGORITHMS for seed in SEEDS}
    title = "[...document.querySelectorAll('*')].find(e => !e.children.length && e.innerText == {})"
    trainings = title.format(json.dumps("Trainings, one line a seed"))
    browser.wait_for(trainings)
    browser.evaluate(f"{trainings}.scrollIntoView()")
    whole = f"{CHARTS}.find(chart => chart.drawn >= {len(names)} && chart.names.includes({json.dumps(min(names))}))"
    browser.wait_for(whole)
    keep(browser, "study_trainings.png", tmp_path)
    assert set(browser.evaluate(whole)["names"]) == names
    text = browser.evaluate("document.body.innerText")
    assert f"SAC-{SEEDS[0]} ({RETURN})" in text
    assert "train/stage" not in text


@pytest.mark.parametrize(("names", "metric"), [
    (list(ALGORITHMS), "iqm/return"), ([f"{label}-{SEEDS[0]}" for label in ALGORITHMS], RETURN),
])  # fmt: skip
def test_a_comparison_opens_on_no_constant(
    names: list[str], metric: str, served_store: Server, run: MLflowRun, browser: Browser, tmp_path: Path
) -> None:
    client, experiment = mlflow_store.connect(served_store.url), str(run.page).split("/")[2]
    found = {each.info.run_name: each.info.run_id for each in client.search_runs([experiment])}
    runs, experiments = quote(json.dumps([found[name] for name in names])), quote(json.dumps([experiment]))
    browser.open(f"{served_store.url}/#/compare-runs?runs={runs}&experiments={experiments}")
    axes = "[...document.querySelectorAll('.parcoords .axis-title')].map(title => title.textContent)"
    browser.wait_for(f"{axes}.length")
    keep(browser, f"comparison_{len(names[0])}.png", tmp_path)
    assert browser.evaluate(axes)[-1] == metric


def test_the_study_has_a_description(served_store: Server, run: MLflowRun, browser: Browser, tmp_path: Path) -> None:
    experiment = str(run.page).split("/")[2]
    browser.open(f"{served_store.url}/#/experiments/{experiment}/runs/{run.run_id}")
    close_assistant(browser)
    more = "[...document.querySelectorAll('button')].find(button => button.innerText == 'Show more')"
    browser.wait_for(more)
    browser.evaluate(f"{more}.click()")
    browser.wait_for("document.body.innerText.includes('Show less')")
    keep(browser, "study_description.png", tmp_path)
    cells = browser.evaluate("[...document.querySelectorAll('td')].map(cell => cell.innerText.trim())")
    assert "SAC > PPO" in cells
