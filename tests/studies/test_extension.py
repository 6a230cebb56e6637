"""What a study that was begun may be extended by, and what is refused, by its key."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from freemesh_ray.cli.command import main
from freemesh_ray.config import ConfigError
from freemesh_ray.studies.definition import Study, load
from freemesh_ray.studies.permitted_changes import extended
from freemesh_ray.studies.study_folder import StudyError, StudyFolder, TrialRecord

VARIANTS = """study:
  title: A test
  seeds: [1, 2]
  domains: [T1]
  expects: [one > two]
  variants:
    one:
    two: {learner.gamma: 0.9}
settings:
  budget.env_steps: 1000
  learner.tau: 0.01
"""
SEARCH = """study:
  title: A search
  seeds: [1]
  search:
    trials: 4
    space:
      learner.gamma: {uniform: [0.9, 0.99]}
    confirm: {best: 2, seeds: [5, 6]}
settings:
  budget.env_steps: 1000
"""


def study(text: str, folder: Path, *change: str) -> Study:
    path = folder / "mine.yaml"
    path.write_text(text.replace(*change) if change else text)
    assert not change or change[0] in text
    return load(path)


def begun(text: str, folder: Path) -> StudyFolder:
    found = StudyFolder(folder / "studies" / "mine")
    found.make()
    found.claim(study(text, folder), resume=False)
    return found


GROWS = [
    (VARIANTS, ("seeds: [1, 2]", "seeds: [1, 2, 3]")),
    (VARIANTS, ("  domains:", "  more_seeds: {one: [3]}\n  domains:")),
    (VARIANTS, ("    one:\n", "    one:\n    three: {learner.gamma: 0.8}\n")),
    (VARIANTS, ("domains: [T1]", "domains: [T1, D4]")),
    (VARIANTS, ("[one > two]", "[one > two, two > one]")),
    (VARIANTS, ("env_steps: 1000", "env_steps: 2000")),
    (VARIANTS, ("title: A test", "title: Another title")),
    (VARIANTS, ("{learner.gamma: 0.9}", "{learner.gamma: 0.9, budget.env_steps: 3000}")),
    (SEARCH, ("seeds: [5, 6]", "seeds: [5, 6, 7]")),
    (SEARCH, ("best: 2", "best: 3")),
]
REFUSED = [
    (VARIANTS, ("seeds: [1, 2]", "seeds: [1, 3]"), "study.seeds (without 2)"),
    (VARIANTS, ("    one:\n", ""), "study.variants (without one)"),
    (VARIANTS, ("gamma: 0.9", "gamma: 0.8"), "study.variants.two.learner.gamma (0.8, was 0.9)"),
    (VARIANTS, ("domains: [T1]", "domains: [D4]"), "study.domains (without T1)"),
    (VARIANTS, ("[one > two]", "[two > one]"), "study.expects (without one > two)"),
    (VARIANTS, ("env_steps: 1000", "env_steps: 500"), "settings.budget.env_steps (500, was 1000)"),
    (VARIANTS, ("tau: 0.01", "tau: 0.02"), "settings.learner.tau (0.02, was 0.01)"),
    (VARIANTS, ("  learner.tau", "  paths.runs: elsewhere\n  learner.tau"), "settings.paths.runs"),
    (SEARCH, ("seeds: [1]", "seeds: [1, 2]"), "study.seeds (a search's draws"),
    (SEARCH, ("trials: 4", "trials: 3"), "study.search.trials (3, was 4)"),
    (SEARCH, ("[0.9, 0.99]", "[0.8, 0.99]"), "study.search.space"),
    (SEARCH, ("env_steps: 1000", "env_steps: 2000"), "settings.budget.env_steps (2000, was 1000: draws are compared"),
    (SEARCH, ("seeds: [5, 6]", "seeds: [5]"), "study.search.confirm"),
]


@pytest.mark.parametrize(("text", "change"), GROWS)
def test_a_study_grows_and_its_first_file_goes_on_with_what_it_is_now(
    text: str, change: tuple[str, str], tmp_path: Path
) -> None:
    text = text.replace("    one:\n", "    one: {}\n") if change[0] != "    one:\n" else text
    text = text.replace("expects: [one > two]", "expects: [one > two]")
    folder = begun(text, tmp_path)
    (folder.tune / "trial").mkdir(parents=True)
    now = study(text, tmp_path, *change)
    assert folder.claim(now, resume=True).tree() == now.tree() == folder.study().tree()
    assert folder.tune.exists() == (text is SEARCH)  # its draws are only there
    assert folder.claim(study(text, tmp_path), resume=True).tree() == now.tree()
    assert folder.study().name == "mine"


@pytest.mark.parametrize(("text", "change", "named"), REFUSED)
def test_what_cannot_change_is_named_and_nothing_is_written(
    text: str, change: tuple[str, str], named: str, tmp_path: Path
) -> None:
    text = text if change[0] != "    one:\n" else text.replace("  expects: [one > two]\n", "")
    folder = begun(text, tmp_path)
    before = folder.definition.read_bytes()
    with pytest.raises(StudyError, match=rf"which cannot change: {re.escape(named)}") as error:
        folder.claim(study(text, tmp_path, *change), resume=True)
    assert "\n" not in str(error.value)
    assert folder.definition.read_bytes() == before
    assert not folder.earlier.exists()
    with pytest.raises(StudyError, match="add --resume"):
        folder.claim(study(text, tmp_path), resume=False)


def test_seeds_of_one_variant_stay_and_may_become_those_of_all(tmp_path: Path) -> None:
    more = "seeds: [1, 2]\n  more_seeds: {one: [3, 4]}"
    folder = begun(VARIANTS.replace("seeds: [1, 2]", more), tmp_path)
    with pytest.raises(StudyError, match=r"cannot change: study\.more_seeds\.one \(without 4\)"):
        folder.claim(study(VARIANTS, tmp_path, "seeds: [1, 2]", "seeds: [1, 2]\n  more_seeds: {one: [3]}"), resume=True)
    now = folder.claim(study(VARIANTS, tmp_path, "seeds: [1, 2]", "seeds: [1, 2, 3, 4]"), resume=True)
    assert {label: list(now.seeds_of(label)) for label in now.variants} == {"one": [1, 2, 3, 4], "two": [1, 2, 3, 4]}


def test_seeds_of_one_variant_are_added(tmp_path: Path) -> None:
    first = study(VARIANTS, tmp_path)
    now = extended(first, ["more_seeds={one: [5, 6]}", "more_seeds={one: [6, 7]}"])
    assert (list(now.seeds_of("one")), list(now.seeds_of("two"))) == ([1, 2, 5, 6, 7], [1, 2])
    assert now.trainings() == 7
    now = extended(now, ["seeds=5,6,7"])
    assert list(now.seeds_of("one")) == list(now.seeds_of("two")) == [1, 2, 5, 6, 7]
    assert load(now.tree()).tree() == now.tree()
    for wrong in ("more_seeds={one: 5}", "more_seeds=[5]", "more_seeds={three: [5]}", "more_seeds={one: [1]}"):
        with pytest.raises(ConfigError, match="more_seeds"):
            extended(first, [wrong])


def test_more_trials_of_a_search_that_is_not_over_are_refused(tmp_path: Path) -> None:
    folder, more = begun(SEARCH, tmp_path), study(SEARCH, tmp_path, "trials: 4", "trials: 6")
    folder.write([TrialRecord(f"draw {i}", 1, f"runs/trial-{i}", "finished") for i in range(3)])
    with pytest.raises(StudyError, match=r"study\.search\.trials: the search is not over"):
        folder.claim(more, resume=True)
    folder.write([TrialRecord(f"draw {i}", 1, f"runs/trial-{i}", "stopped") for i in range(4)])
    (folder.tune / "trial").mkdir(parents=True)
    assert folder.claim(more, resume=True).trainings() == 6
    assert not folder.tune.exists()


def test_additions_are_written_down_without_the_file(tmp_path: Path) -> None:
    before = begun(VARIANTS, tmp_path).study()
    now = extended(
        before,
        ["seeds=4,5", "env_steps=2e3", "variants={three: {learner.gamma: 0.8}}", "expects=three > two", "seeds=4"],
    )
    assert now.seeds == [1, 2, 4, 5]
    assert now.expects == [*before.expects, ("three", ">", "two")]
    assert now.trial_config("three", 4)["budget"]["env_steps"] == 3000
    assert now.name == "mine"
    assert extended(begun(SEARCH, tmp_path / "other").study(), ["trials=3"]).trainings() == 7


@pytest.mark.parametrize(
    ("text", "addition", "message"),
    [
        (VARIANTS, "seed=4", "write KEY=VALUE, of seeds, more_seeds, domains"),
        (VARIANTS, "seeds=many", "study.seeds: must be"),
        (VARIANTS, "trials=2", "a study of variants has no trials"),
        (VARIANTS, "env_steps=-5", "give a whole number, how many more"),
        (VARIANTS, "variants={one: {}}", "one is there already"),
        (SEARCH, "variants={one: {}}", "for a study of variants"),
    ],
)
def test_a_wrong_addition_is_one_line(text: str, addition: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=message) as error:
        extended(begun(text, tmp_path).study(), [addition])
    assert "\n" not in str(error.value)


def test_the_command_shows_what_an_addition_makes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.chdir(tmp_path)
    folder = begun(VARIANTS, tmp_path)
    (tmp_path / "mine.yaml").unlink()
    assert main(["study", "mine", "--add", "seeds=7", "--dry-run"]) == 0
    printed = capsys.readouterr().out
    assert all(f"{label}-7" in printed for label in ("one", "two"))
    assert folder.study().seeds == [1, 2]  # a dry run writes nothing
    assert main(["study", "mine", "--add", "seeds=7", "--set", "learner.tau=0.5", "--dry-run"]) == 2
    assert "leave it out" in capsys.readouterr().err
    assert main(["study", "yours", "--add", "seeds=7"]) == 2
    assert "no such study" in capsys.readouterr().err
