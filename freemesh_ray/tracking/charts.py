"""The page of MLflow's that a study's link opens: its runs with charts of curves first, and constants folded away.

MLflow keeps a page that somebody shares as a tag of the experiment, JSON named `VIEW` and a key, which the page's
address gives as ``viewStateShareKey``. It holds what runs are looked for and which charts are drawn of them. Metrics
without a chart get one of MLflow's own, in a section named by all before their last ``/``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

#: What the experiment's tag begins with.
VIEW = "mlflow.sharedViewState."
#: Ends of the names of an interval's metrics.
LOW, HIGH = "_low", "_high"
#: Titles of the sections, in their order: of each kind of chart.
TITLES = {
    "curves": "Variants: IQM over seeds, 95 % interval dashed",
    "seeds": "Trainings, one line a seed",
    "finals": "Final figures of the variants",
}
#: Sections of MLflow's own that are folded: what trainings record beside their evaluations.
FOLDED = ("train", "learner", "mesh", "finished", "setting", "Model metrics", "System metrics")


def key(run_id: str) -> str:
    """The key of the view of the run that MLflow calls so: an id of ours could be that of another user's run, too."""
    return f"freemesh-{run_id}"


def study_page(experiment: str, run_id: str) -> str:
    """The page of a study, of which `view` was kept, behind the store's address."""
    return f"#/experiments/{experiment}/runs?compareRunsMode=CHART&viewStateShareKey={key(run_id)}"


def run_page(experiment: str, run_id: str, tab: str = "model-metrics") -> str:
    """The page of one run, with its curves."""
    return f"#/experiments/{experiment}/runs/{run_id}/{tab}"


def view(run_id: str, charts: Mapping[str, Sequence[str]]) -> str:
    """The shared view of a study.

    Args:
        run_id: MLflow's, of the study's run.
        charts: names of metrics, by kind: ``curves`` with an interval, which are of `LOW` and `HIGH`; ``seeds``, of
            the trainings; ``finals``. Runs stand in the order of the first of the last, or else of the trainings'.
    """
    drawn: list[dict[str, Any]] = []
    for name in charts.get("curves", ()):
        ends = [f"{name}{LOW}", f"{name}{HIGH}"]
        drawn.append(_line(name, [name, *ends], "curves"))
        drawn += [_line(end, [end], "curves") | {"deleted": True} for end in ends]
    drawn += [_line(name, [name], "seeds") for name in charts.get("seeds", ())]
    drawn += [_chart("BAR", name, [name], "finals") for name in charts.get("finals", ())]
    used = {chart["metricSectionId"] for chart in drawn}
    sections = [_section(kind, title) for kind, title in TITLES.items() if kind in used]
    sections += [_section(name, name, display=False) for name in FOLDED]
    return json.dumps({
        "searchFilter": f"tags.`mlflow.parentRunId` = '{run_id}'",
        # Ordered by their start they would be folded below the study's run.
        "orderByKey": f"metrics.`{[*charts.get('finals', ()), *charts.get('seeds', ()), 'final'][0]}`",
        "orderByAsc": False,
        "runsHiddenMode": "SHOW_ALL",
        "hideEmptyCharts": True,
        "isAccordionReordered": True,
        "compareRunCharts": drawn,
        "compareRunSections": sections,
    }, separators=(",", ":"))  # fmt: skip


def _line(name: str, metrics: list[str], section: str) -> dict[str, Any]:
    """A chart of metrics against steps."""
    axes = {
        "lineSmoothness": 0, "scaleType": "linear", "xAxisScaleType": "linear", "range": {}, "xAxisKey": "step",
        "selectedXAxisMetricKey": "", "yAxisKey": "metric", "yAxisExpressions": [], "ignoreOutliers": False,
        "displayPoints": False, "useGlobalXaxisKey": False, "useGlobalLineSmoothing": False,
    }  # fmt: skip
    return _chart("LINE", name, metrics, section) | axes


def _chart(kind: str, name: str, metrics: list[str], section: str) -> dict[str, Any]:
    return {
        "type": kind, "uuid": f"{section}:{name}", "runsCountToCompare": 10, "metricSectionId": section,
        "deleted": False, "isGenerated": False, "displayName": name, "metricKey": metrics[0],
        "selectedMetricKeys": metrics,
    }  # fmt: skip


def _section(uuid: str, name: str, display: bool = True) -> dict[str, Any]:
    return {
        "uuid": uuid, "name": name, "display": display, "isReordered": True, "deleted": False, "isGenerated": False,
    }  # fmt: skip
