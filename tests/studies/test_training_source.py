"""What makes two trainings one: the source that training depends on, and no other file."""

from __future__ import annotations

import ast
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from checkout import ROOT

from freemesh_ray import config
from freemesh_ray.studies import plan
from freemesh_ray.studies.training_source import INSTALLED, OUTSIDE, PACKAGES, code_files, digest, training_source

#: What the modules of `PACKAGES` import besides, and why it decides nothing of what is learnt.
WITHOUT_PART = {
    "freemesh_ray.export": "writes meshes",
    "freemesh_ray.finish": "finishes the meshes at the end",
    "freemesh_ray.formatting": "writes tables",
    "freemesh_ray.local_ray": "starts Ray",
    "freemesh_ray.mesher": "makes the meshes at the end",
    "freemesh_ray.mesh_geometry": "measures them",
    "freemesh_ray.plots": "draws",
    "freemesh_ray.storage": "writes and reads files whole",
    "freemesh_ray.tracking": "tells MLflow",
}


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the source, to be changed."""
    root = tmp_path_factory.mktemp("source")
    for package in ("envs", "freemesh_ray"):
        shutil.copytree(ROOT / package, root / package, ignore=shutil.ignore_patterns("__pycache__", "*.npz"))
    return root


def digests(root: Path) -> dict[str, str]:
    return {package: digest(code_files(root, package), root) for package in PACKAGES}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "package"),
    [
        ("envs/mdp/reward.py", "envs"),
        ("envs/domains/catalogue/T1.json", "envs"),
        ("freemesh_ray/algorithms/sac_learner.py", "freemesh_ray/algorithms"),
        ("freemesh_ray/training/loop.py", "freemesh_ray/training"),
        ("freemesh_ray/policies/evaluation.py", "freemesh_ray/policies"),
        ("freemesh_ray/report/one_study.py", None),
        ("freemesh_ray/serving/http_process.py", None),
        ("freemesh_ray/studies/runner.py", None),
        ("freemesh_ray/cli/study.py", None),
        ("envs/rendering/window.py", None),
    ],
)
def test_a_changed_learner_is_another_source_and_a_changed_report_is_none(
    file: str, package: str | None, source: Path
) -> None:
    before, path = digests(source), source / file
    text = path.read_text()
    path.write_text(f"{text}\nCHANGED = 1\n")
    try:
        changed = [name for name, value in digests(source).items() if value != before[name]]
    finally:
        path.write_text(text)
    assert changed == ([package] if package else [])


@pytest.mark.slow
def test_sentences_are_no_source(source: Path) -> None:
    before, path = digests(source), source / "freemesh_ray/algorithms/sac_learner.py"
    text = path.read_text()
    rest = text.partition('"""\n')[2]
    path.write_text(f'"""Another sentence."""\n\n# A comment.\n{rest}')
    try:
        assert digests(source) == before
    finally:
        path.write_text(text)


def imported(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (
                [f"freemesh_ray.{a.name}" for a in node.names] if node.module == "freemesh_ray" else [node.module]
            )


@pytest.mark.slow
def test_all_that_training_imports_is_source_or_known_to_decide_nothing() -> None:
    files = [path for package in PACKAGES for path in code_files(ROOT, package) if path.suffix == ".py"]
    modules = {name for path in files for name in imported(path)}
    own = {".".join(name.split(".")[:2]) for name in modules if name.startswith("freemesh_ray.")}
    known = {package.replace("/", ".") for package in PACKAGES}
    assert own - known <= set(WITHOUT_PART)
    assert all((ROOT / file).is_file() for file in OUTSIDE)
    assert set(training_source()) == known | set(INSTALLED)


def test_another_content_of_a_stage_s_file_is_another_run(tmp_path: Path) -> None:
    path = tmp_path / "part.geojson"
    path.write_text("one")
    tree = config.load([{"curriculum.stages": [str(path)]}])
    before = plan.identity(tree, {})
    assert plan.identity(tree, {}) == before
    path.write_text("two")
    assert plan.identity(tree, {}) != before


def test_lengths_of_one_training_have_folders_of_one_lineage() -> None:
    short, long = (plan.placed(config.load([{"budget.env_steps": steps}]), {})["name"] for steps in (1000, 2000))
    assert short != long
    assert plan.lineage(short) == plan.lineage(Path("runs") / long)
    assert short.endswith("-1000")
