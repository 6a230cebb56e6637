"""Study files: what is read, what is refused and how, and what makes two trainings the same."""

from __future__ import annotations

import re
from dataclasses import MISSING, fields
from pathlib import Path

import pytest
import yaml
from checkout import ROOT
from hypothesis import given
from hypothesis import strategies as st
from plugged import modules

from envs.errors import PluginError
from freemesh_ray import config
from freemesh_ray.cli.command import main
from freemesh_ray.config import SCHEMA, SHORTHANDS, ConfigError
from freemesh_ray.studies import plan
from freemesh_ray.studies.definition import KEYS, SEARCH_KEYS, Search, Study, load, shipped
from freemesh_ray.studies.label import file_name, short_label
from freemesh_ray.studies.label import label as full_label
from freemesh_ray.studies.runner import merged
from freemesh_ray.studies.study_folder import StudyError, TrialRecord

STUDIES = {
    "algorithms": 19, "domains": 19, "networks": 19, "seeds": 10, "observation": 16, "radius": 16, "density": 25,
    "search": 1, "population": 1,
}  # fmt: skip
#: Those that are not of the paper.
OURS = {"learner": 40, "mdp": 37, "methods": 50, "updates": 40}
SOURCE = {"envs": "a digest", "torch": "a version"}
GOOD = """study:
  title: A test
  seeds: [1, 2]
  variants:
    one:
    two: {learner.gamma: 0.9}
settings:
  budget:
    env_steps: 1000
"""


def written(text: str, folder: Path) -> Path:
    path = folder / "mine.yaml"
    path.write_text(text)
    return path


# ---- the studies that ship -------------------------------------------------------------------------------------------


def test_every_study_of_the_paper_ships():
    assert set(shipped()) == {*STUDIES, *OURS}


@pytest.mark.parametrize("name", OURS)
def test_a_study_of_our_own_is_whole(name: str):
    trials = plan.variant_plan(load(name), SOURCE).trials
    assert len({str(trial.folder.path) for trial in trials.values()}) == len(trials) == OURS[name]


@pytest.mark.parametrize("name", STUDIES)
def test_a_shipped_study_is_whole(name: str):
    study = load(name)
    assert study.finding
    assert study.paper
    if study.search is None:
        trials = plan.variant_plan(study, SOURCE).trials
        assert len(trials) == STUDIES[name]
        assert len({str(trial.folder.path) for trial in trials.values()}) == STUDIES[name]
        assert {seed for _, seed in ((t.label, t.seed) for t in trials.values())} >= {356, 567, 999}


@pytest.mark.slow
def test_the_default_training_is_the_same_run_in_every_study_of_the_paper():
    default = {"algorithms": "SAC", "domains": "T1", "networks": "S2", "seeds": "A", "observation": "O2",
               "radius": "R2", "density": "medium"}  # fmt: skip
    runs = {plan.variant_plan(load(name), SOURCE).trials[f"{label}-356"].folder.path for name, label in default.items()}
    assert len(runs) == 1


def test_a_search_begins_with_the_study_s_own_settings():
    for name in ("search", "population"):
        study = load(name)
        assert study.search is not None
        point = plan.default_point(study)
        assert set(point) == set(study.search.space)
        given_ = {**point, "something": "else"}
        assert {each.label for each in plan.SearchPlan(study, Path("runs")).trainings(given_, "a1b2_00000")} == {
            plan.DEFAULT
        }


def test_a_setting_that_is_a_list_can_be_searched(tmp_path: Path):
    space = "learner.hidden: {choice: [[64, 64], [128, 128, 128]]}"
    study = load(written(SEARCH.replace("learner.gamma: {uniform: [0.9, 0.99]}", space), tmp_path))
    search = plan.SearchPlan(study, tmp_path)
    assert study.search is not None
    assert (
        plan.default_point(study)["learner.hidden"] in study.search.space["learner.hidden"].values
    )  # as Tune draws it
    (default,), (other,) = (
        search.trainings(plan.default_point(study), "a1"), search.trainings({"learner.hidden": (64, 64)}, "b2")
    )  # fmt: skip
    assert (default.label, other.label) == (plan.DEFAULT, "hidden 64x64 (b2)")
    assert other.folder.path.name == "trial-hidden-64x64-b2-1"
    assert [trial.config["learner"]["hidden"] for trial in (default, other)] == [[128, 128, 128], [64, 64]]


def test_the_documents_have_every_key_with_its_default():
    text, _, _ = (ROOT / "docs" / "studies.md").read_text().partition("## What it leaves")
    rows = re.findall(r"^\| `(\w+)` \| .+? \| (.*) \|$", text, re.MULTILINE)
    written_down = {name: default.strip("`").replace(",", "") for name, default in rows}
    expected = {"title": "must be given", "space": "must be given", "trials": "must be given"}
    expected |= {"more_seeds": "none", "variants": "this `grid` or `search", "grid": "this `variants` or `search"}
    expected |= {"search": "this `variants` or `grid", "confirm": "none"}
    for keys, kind in ((KEYS, Study), (SEARCH_KEYS, Search)):
        defaults = {field.name: field.default for field in fields(kind) if field.name in keys}
        assert set(defaults) == set(keys)
        expected |= {
            name: f"{value:g}" if isinstance(value, int | float) else str(value or "none")
            for name, value in defaults.items()
            if value is not MISSING
        }
    assert written_down == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("one > two", ("one", ">", "two")),
        ("two=one", ("two", "=", "one")),
        ("gamma=.9 > gamma=.99", ("gamma=.9", ">", "gamma=.99")),
        ("gamma=.9 = one", ("gamma=.9", "=", "one")),
    ],
)
def test_expectations_are_read_and_written_as_they_were(tmp_path: Path, text: str, expected: tuple[str, str, str]):
    labels = dict.fromkeys(["one", "two", "gamma=.9", "gamma=.99"])
    study = load({"study": {"title": "T", "seeds": [1], "variants": labels, "expects": [text]}})
    assert study.expects == [expected]
    assert load(study.tree()).expects == study.expects


def test_an_expectation_that_can_be_read_in_two_ways_is_refused():
    labels = dict.fromkeys(["a", "b", "a = b"])
    with pytest.raises(ConfigError, match="'a = b = a': can be read in 2 ways"):
        load({"study": {"title": "T", "seeds": [1], "variants": {**labels, "b = a": None}, "expects": ["a = b = a"]}})


# ---- what is refused -------------------------------------------------------------------------------------------------

BAD = [
    ("learner: {gamma: 0.9}\n", "1: learner: unknown part of a study"),
    ("settings:\n  learner:\n    gamma: 0.9\n", "is no study"),
    (GOOD.replace("gamma: 0.9", "gama: 0.9"), "6: learner.gama: unknown key: did you mean learner.gamma?"),
    (GOOD.replace("gamma: 0.9", "gamma: 2"), "6: learner.gamma: must be a number in [0, 1], not 2"),
    (GOOD.replace("env_steps: 1000", "steps: 1000"), "9: budget.steps: unknown key"),
    (GOOD.replace("  seeds: [1, 2]\n", ""), "study.seeds is missing"),
    (GOOD.replace("[1, 2]", "[1, 1]"), "3: study.seeds: must be a list of one or more different values"),
    (GOOD.replace("  title: A test\n", ""), "study.title is missing"),
    (GOOD.replace("  variants", "  more_seeds: {on: [3]}\n  variants"),
     "4: study.more_seeds.on: is no variant: known are one, two"),
    (GOOD.replace("  variants", "  more_seeds: {one: [3, 2]}\n  variants"),
     "4: study.more_seeds.one: 2 is among study.seeds: remove it here"),
    (GOOD.replace("  variants", "  more_seeds: {one: 3}\n  variants"),
     "4: study.more_seeds.one: must be a list of one or more different values"),
    (GOOD.replace("seeds: [1, 2]", "more_seeds: {one: [3]}").replace("one:\n", "one: {seed: 1}\n")
     .replace("gamma: 0.9", "gamma: 0.9, seed: 2"), "either every variant sets its seed, or study.seeds does for all"),
    (GOOD.replace("  seeds", "  sedes: 3\n  seeds"), "3: study.sedes: unknown key"),
    (GOOD.replace("  seeds", "  expects: [one > three]\n  seeds"), "3: study.expects: 'one > three': write LABEL"),
    (GOOD.replace("  seeds", "  expects: [one = one]\n  seeds"), "3: study.expects: 'one = one': write LABEL"),
    (GOOD.replace("  seeds", "  metric: loss\n  seeds"), "3: study.metric: must be eval_deterministic/return"),
    (GOOD.replace("{learner.gamma: 0.9}", "{seed: 3}"), "either every variant sets its seed, or study.seeds"),
    (GOOD.replace("    two: {learner.gamma: 0.9}", "    one: {learner.gamma: 0.9}"), "6: one: already set at line 5"),
    (GOOD.replace("one:", "'one/two':"), "5: study.variants: must be up to 60 letters"),
    (GOOD.replace("  variants:\n    one:\n    two: {learner.gamma: 0.9}\n", ""), "give variants"),
    ("study: [1]\n", "1: study: must be keys"),
    ("", "1: is empty"),
]  # fmt: skip

SEARCH = """study:
  title: A search
  seeds: [1]
  search:
    trials: 4
    space:
      learner.gamma: {uniform: [0.9, 0.99]}
"""
GRID = GOOD.replace("variants:\n    one:\n    two: {learner.gamma: 0.9}", "grid: {learner.gamma: [0.9, 0.99]}")
BAD_GRIDS = [
    (GRID.replace("0.99]", "0.9]"), "4: study.grid.learner.gamma: has a value twice"),
    (GRID.replace("0.99]", "2]"), "4: learner.gamma: must be a number in [0, 1], not 2"),
    (GRID.replace("[0.9, 0.99]", "0.9"), "4: study.grid.learner.gamma: write a list of values"),
    (GRID.replace("learner.gamma", "learner.gama"), "4: learner.gama: unknown key"),
    (GRID.replace("learner.gamma: [0.9, 0.99]", "seed: [1, 2]"), "4: study.grid.seed: is not varied"),
    (GRID.replace("[0.9, 0.99]", "[0.9, 0.90000001]"), "'gamma 0.9': two combinations have this label"),
    (GRID.replace("  grid:", "  variants: {one: }\n  grid:"), "give variants (label: settings), a grid or a search"),
]  # fmt: skip
BAD_SEARCHES = [
    (SEARCH.replace("uniform", "normal"), "7: study.search.space.learner.gamma: write {uniform"),
    (SEARCH.replace("0.99]", "1.5]"), "7: learner.gamma: must be a number in [0, 1], not 1.5"),
    (SEARCH.replace("[0.9, 0.99]", "[0.99, 0.9]"), "7: study.search.space.learner.gamma: needs two numbers"),
    (SEARCH.replace("uniform: [0.9", "log: [0"), "log needs numbers above 0"),
    (SEARCH.replace("learner.gamma", "learner.gama"), "7: learner.gama: unknown key"),
    (SEARCH.replace("learner.gamma: {uniform: [0.9, 0.99]}", "learner.batch_size: {uniform: [1, 9]}"), "with choice"),
    (SEARCH.replace("    trials: 4\n", ""), "needs trials"),
    (SEARCH.replace("\n      learner.gamma: {uniform: [0.9, 0.99]}", " {}"), "needs trials"),
    (
        SEARCH.replace("seeds: [1]", "seeds: [1, 2]").replace("trials: 4", "trials: 4\n    scheduler: pbt"),
        "3: study.seeds: a population has one seed",
    ),
    (SEARCH.replace("trials: 4", "trials: 4\n    confirm: {seeds: [1, 5]}"), "confirm.seeds: 1 is one of the search's"),
    (SEARCH.replace("trials: 4", "trials: 4\n    confirm: {best: 3}"), "6: study.search.confirm.seeds is missing"),
    (
        SEARCH.replace("trials: 4", "trials: 4\n    scheduler: pbt\n    confirm: {seeds: [5]}"),
        "7: study.search.confirm: a population's settings change",
    ),
    (SEARCH.replace("trials: 4", "trials: 4\n    shape: round"), "6: study.search.shape: unknown key"),
]


@pytest.mark.parametrize(("text", "message"), BAD + BAD_GRIDS + BAD_SEARCHES)
def test_what_is_wrong_is_one_line_with_its_place(
    text: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture
):
    path = written(text, tmp_path)
    assert main(["study", str(path), "--dry-run"]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.startswith(f"freemesh: {path}:")
    assert error.count("\n") == 1


def test_a_setting_over_what_trials_differ_in_is_refused(tmp_path: Path):
    path = written(GOOD, tmp_path)
    with pytest.raises(
        ConfigError, match=r"--set learner.gamma=0.8: learner.gamma is what the study's trials differ in"
    ):
        load(path, ["learner.gamma=0.8"])
    assert load(path, ["learner.tau=0.01"]).trial_config("two", 1)["learner"]["tau"] == 0.01


def test_an_unknown_study_is_named(capsys: pytest.CaptureFixture):
    assert main(["study", "algoritms"]) == 2
    assert "algoritms: no such configuration" in capsys.readouterr().err


def test_settings_of_one_training_are_no_study(capsys: pytest.CaptureFixture):
    assert main(["study", "train_smoke"]) == 2
    assert "unknown part of a study" in capsys.readouterr().err


def test_a_grid_is_every_combination_by_a_readable_label(tmp_path: Path):
    more = "grid: {learner.gamma: [0.9, 0.99], learner.hidden: [[64, 64], [128]], budget.minutes: [null, 2]}"
    study = load(written(GRID.replace("grid: {learner.gamma: [0.9, 0.99]}", more), tmp_path))
    assert len(study.variants) == 8
    assert list(study.variants)[:3] == [
        "gamma 0.9, hidden 64x64, minutes none", "gamma 0.9, hidden 64x64, minutes 2",
        "gamma 0.9, hidden 128, minutes none",
    ]  # fmt: skip
    tree = study.trial_config("gamma 0.99, hidden 128, minutes 2", 1)
    assert [tree["learner"]["gamma"], tree["learner"]["hidden"], tree["budget"]["minutes"]] == [0.99, [128], 2.0]
    assert load(written(config.dump(study.tree()), tmp_path)).tree() == study.tree()


def test_labels_are_short_and_tell_settings_apart():
    drawn = {"learner.learning_rate": 8.1357e-4, "td3.batch_size": 64, "sac.batch_size": 8, "env.M_angle": 1.23456}
    assert short_label(drawn) == "lr 0.000814, td3.batch_size 64, sac.batch_size 8, M_angle 1.23"
    assert full_label({"env.reward": "rewards/mine:Reward", "a.on": True}) == "reward Reward, on on"
    assert file_name("gamma 0.9, hidden 64x64 (b2)") == "gamma-0.9-hidden-64x64-b2"


# ---- what comes of it ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_written_down_is_the_same_study(name: str, tmp_path: Path):
    study = load(name, ["learner.warmup_steps=777"])
    path = written(config.dump(study.tree()), tmp_path)
    again = load(path)
    assert again.tree() == study.tree()
    for label in study.variants:
        assert again.trial_config(label, 5) == study.trial_config(label, 5)


@pytest.mark.slow
def test_a_dry_run_prints_every_trial_and_writes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["study", "networks", "--dry-run"]) == 0
    printed = capsys.readouterr().out
    assert all(f"S{i}-{seed}" in printed for i in (1, 2, 3, 4) for seed in (356, 567, 999))
    assert "learner.hidden=[32, 128, 128, 128, 64, 32]" in printed
    assert not list(tmp_path.iterdir())


def test_the_list_of_studies(capsys: pytest.CaptureFixture):
    assert main(["study"]) == 0
    printed = capsys.readouterr().out
    assert all(name in printed for name in STUDIES)


OTHER = {str: "other", bool: True, int: 7, float: 0.123}


@given(st.sampled_from(sorted(set(SCHEMA) - set(SHORTHANDS))))
def test_a_run_s_identity_is_all_that_decides_its_result(key: str):
    tree = config.load()
    flat = config.flatten(tree)
    section, _, name = key.rpartition(".")
    changed = {**tree, section: {**tree[section], name: OTHER}} if section else {**tree, name: "other"}
    if section:
        value = OTHER[SCHEMA[key].kind]
        changed[section][name] = value if flat[key] != value else "yet another"
    same = plan.identity(changed, SOURCE) == plan.identity(tree, SOURCE)
    others = ("td3.", "ddpg.", "crossq.", "ppo.")  # the tree is sac's
    assert same == (key.startswith(plan.OUTSIDE_IDENTITY + others) or key == plan.LENGTH)


def test_another_source_is_another_run():
    assert plan.identity(config.load(), {"envs": "1"}) != plan.identity(config.load(), {"envs": "2"})
    assert len(plan.identity(config.load(), SOURCE)) == 12


def test_another_plug_in_is_another_run(tmp_path: Path):
    with modules(tmp_path) as write:
        module = write("def reward(step): return step.reward\n")
        tree = config.load([], [f"env.reward={module}:reward"])
        before = plan.identity(tree, SOURCE)
        assert plan.identity(tree, SOURCE) == before != plan.identity(config.load(), SOURCE)
        (tmp_path / f"{module}.py").write_text("def reward(step): return 2 * step.reward\n")
        assert plan.identity(tree, SOURCE) != before


def test_the_algorithm_of_a_user_s_has_its_settings_in_every_part_of_a_study(tmp_path: Path):
    source = (
        "from freemesh_ray.config import Algorithm, Field, Hyperparameter\n"
        "MINE = Algorithm('nowhere:Config', {'speed': Hyperparameter(0.5, Field(float, 0, 1))})\n"
    )
    with modules(tmp_path) as write:
        module = write(source)
        text = (
            "study:\n  title: Mine\n  seeds: [1]\n  variants:\n    sac: {algorithm: sac}\n"
            "    fast: {algorithm: MINE, mine.speed: 1}\nsettings: {mine.speed: 0.25}\n"
        )
        path = written(text.replace("MINE,", f"'{module}:MINE',"), tmp_path)
        study = load(path)
        assert [study.trial_config(label, 1)["mine"]["speed"] for label in ("sac", "fast")] == [0.25, 1.0]
        assert study.trial_config("fast", 1)["algorithm"] == f"{module}:MINE"
    with modules(tmp_path / "elsewhere"), pytest.raises(PluginError, match=f"no module {module}"):
        load(path, beside=False)


def test_a_variant_s_settings_win_over_the_study_s(tmp_path: Path):
    tree = yaml.safe_load(GOOD)
    tree["settings"]["learner"] = {"gamma": 0.5}
    study = load(written(yaml.safe_dump(tree), tmp_path))
    assert [study.trial_config(label, 3)["learner"]["gamma"] for label in ("one", "two")] == [0.5, 0.9]
    assert study.trial_config("one", 3)["seed"] == 3


def test_a_study_goes_on_with_its_trials_as_they_were_left():
    def entries(*statuses: str, source: str = "a", steps: int = 100) -> list[TrialRecord]:
        return [
            TrialRecord("one", i, f"../../runs/trial-{source}{i}-{steps}", status) for i, status in enumerate(statuses)
        ]

    left = merged(entries("finished", "finished", "pending"), entries("running", "pending", "failed"))
    assert [entry.status for entry in left] == ["finished", "finished", "failed"]
    assert [entry.shared for entry in left] == [False, True, False]  # the first is its own, the second another's
    with pytest.raises(StudyError, match="one-0: was begun with other code"):
        merged(entries("pending", source="b"), entries("running"))
    longer = merged(entries("pending", "finished", steps=200), entries("finished", "finished"))
    assert [entry.status for entry in longer] == ["pending", "finished"]
    assert {entry.run.rpartition("-")[2] for entry in longer} == {"200"}
