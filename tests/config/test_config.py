"""The settings tree: round trips, layers, numbers, and what is said about every kind of mistake."""

from __future__ import annotations

import math
import re
from dataclasses import asdict
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from envs.plug_ins.environment_parts import PlugIns
from envs.plug_ins.lookup import SPEC
from envs.types import NAMED, SETTINGS, TINY, MeshingParameters
from freemesh_ray.config import (
    ALGORITHMS,
    SCHEMA,
    SHORTHANDS,
    ConfigError,
    Field,
    dump,
    flatten,
    load,
    meshing_parameters,
)

#: (smaller, larger): the first key's value is at most the second's.
AT_MOST = {(algorithm.batch, algorithm.experience) for algorithm in ALGORITHMS.values()}
DEFAULTS_TEXT = (resources.files("tune_configs") / "defaults.yaml").read_text(encoding="utf-8")


def values_of(key: str, field: Field) -> st.SearchStrategy:
    """Every kind of value that ``field`` accepts."""
    if field.many:
        item = values_of(key, Field(field.kind, field.low, field.high, field.words, pattern=field.pattern))
        return st.lists(item, min_size=not field.empty, max_size=4, unique=field.distinct)
    if field.kind is bool:
        one: st.SearchStrategy = st.booleans()
    elif field.kind is int:
        one = st.integers(int(field.low), int(field.high))
    elif field.kind is float:
        one = st.floats(field.low, field.high)
    elif field.pattern == SPEC:
        one = st.sampled_from(["mine:Name", "my.module:Some.name_2", "ünï:ü"])
    elif field.words or key == "name":
        one = st.sampled_from(field.words or ("main", "1e6", "null", "true", "a.b-c_d", "010"))
    elif key == "tracking.uri":
        one = st.sampled_from(["sqlite:///a b.db", "sqlite:////tmp/ünï.db", "http://host:5000", "https://host/#x"])
    else:
        texts = ["T1", "1e6", "3e-4", "null", "yes", "ünï", "a: b", "# x", "'"]
        one = st.sampled_from(texts if key.startswith("paths.") else [*texts, "sqlite:///a b.db"])
    if field.words and field.kind is not str:
        one |= st.sampled_from(field.words)
    return one | st.none() if field.optional else one


def written(tree: dict, folder: Path, name: str = "overlay.yaml") -> Path:
    path = folder / name
    path.write_text(tree if isinstance(tree, str) else yaml.safe_dump(tree), encoding="utf-8")
    return path


# ---- the defaults ----------------------------------------------------------------------------------------------------


def test_the_defaults_hold_exactly_the_keys_of_the_schema_each_with_a_comment():
    assert list(flatten(yaml.safe_load(DEFAULTS_TEXT))) == list(SCHEMA)
    keys = [line for line in DEFAULTS_TEXT.splitlines() if line.strip() and not line.strip().startswith("#")]
    sections = (
        "env:",
        "curriculum:",
        "learner:",
        "sac:",
        "ppo:",
        "runners:",
        "evaluation:",
        "checkpoint:",
        "tracking:",
        "paths:",
    )
    assert [line for line in keys if " # " not in line] == [line for line in keys if line.strip() in sections]


def test_the_defaults_of_an_algorithm_are_those_of_its_entry():
    written_out = yaml.safe_load(DEFAULTS_TEXT)
    for name, algorithm in ALGORITHMS.items():
        assert written_out[name] == {key: setting.default for key, setting in algorithm.settings.items()}
        assert load([], [f"algorithm={name}"])[name] == written_out[name]


def test_the_defaults_are_the_environments_own():
    assert meshing_parameters(load()) == MeshingParameters()
    assert set(load()["env"]) == {*asdict(MeshingParameters()), *NAMED, *asdict(PlugIns())}


NUMBER = r"(-?[0-9.]+(?:e[0-9]+)?|pi)"
#: How a comment prints a range: ``1 to 8``, ``above 0, to 1e9``.
RANGE = re.compile(rf"(?:(above 0,)|{NUMBER}) to {NUMBER}(?![\w.])")


def comments() -> dict[str, str]:
    """The comment beside each key of the defaults, its lines joined."""
    found: dict[str, str] = {}
    section = key = ""
    for line in DEFAULTS_TEXT.splitlines():
        text = line.partition("# ")[2].strip()
        if setting := re.match(r"( *)(\w+):", line):
            section = section if setting[1] else setting[2]
            key = f"{section}.{setting[2]}" if setting[1] else setting[2]
            found[key] = text
        elif line.startswith(" "):
            found[key] += f" {text}"
    return found


def test_the_defaults_print_the_range_of_every_number_and_every_word():
    printed = comments()
    for key, field in SCHEMA.items():
        ranges = [
            (TINY if above else float(low), math.pi if high == "pi" else float(high))
            for above, low, high in RANGE.findall(printed[key])
        ]
        assert ranges == ([(field.low, field.high)] if field.kind in (int, float) else []), key
        for word in [*field.words, *(["null"] if field.optional else [])]:
            assert re.search(rf"\b{word}\b", printed[key]), (key, word)


def test_the_defaults_say_of_the_environment_what_it_says_itself():
    for name, setting in SETTINGS.items():
        assert RANGE.sub("", comments()[f"env.{name}"]).removesuffix("; ") == setting.meaning


@pytest.mark.parametrize("name", [name for name, setting in SETTINGS.items() if setting.kind in (int, float)])
def test_the_environment_accepts_its_ranges_and_nothing_beyond(name: str):
    setting = SETTINGS[name]
    for bound in (setting.low, setting.high):
        value = getattr(MeshingParameters(**{name: setting.kind(bound)}), name)
        assert (value, type(value)) == (bound, setting.kind)
        assert getattr(MeshingParameters(**{name: np.float64(bound)}), name) == bound
    for wrong in (setting.low - 1, setting.high * 2, math.nan, math.inf, True, "1", [1]):
        with pytest.raises(ValueError, match=rf"^MeshingParameters.{name} = .*: must be a (whole )?number in "):
            MeshingParameters(**{name: wrong})


def test_whole_numbers_switches_and_words_are_checked_too():
    for name, setting in SETTINGS.items():
        for wrong in {bool: (0, 1, "true"), int: (1.5,), str: ("x", 1, True), float: ()}[setting.kind]:
            with pytest.raises(ValueError, match=f"MeshingParameters.{name} = "):
                MeshingParameters(**{name: wrong})


@pytest.mark.parametrize("name", ["train_default", "train_paper", "train_smoke"])
def test_shipped_overlays_load_by_name_and_by_path(name: str):
    with resources.as_file(resources.files("tune_configs") / f"{name}.yaml") as path:
        assert load([name]) == load([path])


def test_overlays_say_what_they_are_for():
    usual, ours = flatten(load()), flatten(load(["train_default"]))
    assert {key for key in usual if ours[key] != usual[key]} == {
        "name", "env.upsilon", "learner.gamma", "learner.precision", "sac.policy_delay", "budget.env_steps"
    }  # fmt: skip
    paper = load(["train_paper"])
    assert paper["budget"] == {"env_steps": 1_200_000, "minutes": None}
    assert paper["learner"]["updates_per_step"] == 1.0
    assert load(["train_smoke"])["curriculum"]["stages"] == ["T1"]


# ---- properties ------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(st.fixed_dictionaries({}, optional={key: values_of(key, field) for key, field in SCHEMA.items()}))
def test_what_is_dumped_loads_to_the_same_tree(tmp_path: Path, chosen: dict):
    defaults = flatten(load())
    for small, large in AT_MOST:
        if chosen.get(small, defaults[small]) > chosen.get(large, defaults[large]):
            chosen |= {small: 1}
    shared = ALGORITHMS[chosen.get("algorithm", defaults["algorithm"])].batch
    if chosen.get(shared, defaults[shared]) % max(1, chosen.get("learner.count", 0)):
        chosen |= {"learner.count": 1}
    sets = [f"{key}={yaml.safe_dump(value, default_flow_style=True, width=10**6).split('...')[0].strip()}"
            for key, value in chosen.items() if not isinstance(value, str | list)]  # fmt: skip
    tree: dict = {}
    for key, value in chosen.items():
        if isinstance(value, str | list):
            section, _, name = key.rpartition(".")
            (tree.setdefault(section, {}) if section else tree)[name] = value
    config = load([written(dump(tree), tmp_path)] if tree else [], sets)
    assert load([written(dump(config), tmp_path)]) == config
    for key, value in chosen.items():
        if not any(key in sets_ or key == short for short, names in SHORTHANDS.items() for sets_ in names.values()):
            assert flatten(config)[key] == flatten({key: value})[key], key


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(st.integers(1, 10**9))
def test_whole_numbers_may_be_written_as_floats(steps: int):
    for text in (f"{steps}", f"{steps}.0", f"{steps}e0", f"{steps:.15e}", f"+{steps}"):
        value = load(sets=[f"budget.env_steps={text}"])["budget"]["env_steps"]
        assert value == steps
        assert type(value) is int


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(st.floats(1e-9, 1.0))
def test_every_way_to_write_a_float_is_read(rate: float):
    for text in (repr(rate), f"{rate:.17e}", f"{rate:.17E}", f"{rate:.17e}".replace("e-0", "e-")):
        value = load(sets=[f"learner.learning_rate={text}"])["learner"]["learning_rate"]
        assert value == rate
        assert type(value) is float


def test_later_layers_win(tmp_path: Path):
    first = written({"learner": {"gamma": 0.5, "tau": 0.1}}, tmp_path, "first.yaml")
    second = written({"learner": {"gamma": 0.6}}, tmp_path, "second.yaml")
    learner = load([first, second], ["learner.tau=0.2", "learner.tau=0.3"])["learner"]
    assert (learner["gamma"], learner["tau"]) == (0.6, 0.3)


def test_loading_twice_gives_trees_that_share_nothing():
    first = load()
    first["learner"]["hidden"].append(1)
    first["env"]["n"] = 7
    assert load() != first
    assert load() == load()


@pytest.mark.parametrize("name", NAMED["observation"])
def test_a_named_observation_sets_its_numbers(name: str):
    env = load(sets=[f"env.observation={name}"])["env"]
    assert env.items() >= NAMED["observation"][name].items()
    assert env["observation"] == name


def test_a_number_beside_or_after_a_name_has_its_way_and_the_name_is_dropped(tmp_path: Path):
    path = written("env:\n  n: 5\n  observation: O3\n  radius: R1\n", tmp_path)
    env = load([path])["env"]
    assert (env["n"], env["g"], env["observation"]) == (5, 4, None)
    assert (env["alpha"], env["radius"]) == (1.0, "R1")
    assert load([path], ["env.alpha=2.5"])["env"]["radius"] is None
    assert load([path], ["env.n=3"])["env"]["observation"] == "O3"


def test_flatten_gives_scalars_only():
    flat = flatten(load())
    assert list(flat) == list(SCHEMA)
    assert all(isinstance(value, str | int | float | bool | None) for value in flat.values())
    assert flat["learner.hidden"] == "[128, 128, 128]"


def test_an_empty_section_changes_nothing(tmp_path: Path):
    assert load([written("name: x\nlearner:\n  # gamma: 0.5\n", tmp_path)]) == {**load(), "name": "x"}


# ---- mistakes --------------------------------------------------------------------------------------------------------

BAD_SETS = [
    ("learner.lerning_rate=1", "learner.lerning_rate: unknown key: did you mean learner.learning_rate?"),
    ("gama=1", "gama: unknown key: did you mean learner.gamma?"),
    ("minutes=1", "minutes: unknown key: did you mean budget.minutes?"),
    ("zzzz=1", "zzzz: unknown key: known are name, seed"),
    ("learner.gamma", "is not key=value: write for example learner.gamma=0.95"),
    ("=1", "is not key=value"),
    ("learner.gamma=1.5", "learner.gamma: must be a number in [0, 1], not 1.5"),
    ("learner.gamma=.nan", "learner.gamma: must be a number in [0, 1], not NaN"),
    ("learner.gamma=true", "learner.gamma: must be a number in [0, 1], not true"),
    ("learner.gamma='0.5'", 'learner.gamma: must be a number in [0, 1], not "0.5"'),
    ("learner.gamma=", "learner.gamma: must be a number in [0, 1], not null"),
    ("learner.gamma=2020-99-99", "learner.gamma: must be a number in [0, 1]"),
    ("learner.gamma=[0.5", "is not valid YAML: expected ',' or ']'"),
    ("learner.gamma=!!python/object:os.system {}", "learner.gamma: must be a number in [0, 1]"),
    ("learner=3", "learner: is a section: write keys below it, for example learner.buffer_size: ..."),
    ("learner.gamma.x=3", "learner.gamma.x: unknown key: did you mean learner.gamma?"),
    ("learner.batch_size=1.5", "learner.batch_size: must be a whole number in [1, 1000000], not 1.5"),
    ("seed=1e400", "seed: must be a whole number in [0, 2147483647], not Infinity"),
    ("seed=-1", "seed: must be a whole number in [0, 2147483647], not -1"),
    ("env.type2=1", "env.type2: must be true or false, not 1"),
    ("env.density=dense", 'env.density: must be continuous or printed or local, not "dense"'),
    ("env.observation=O4", 'env.observation: must be O1 or O2 or O3 or null, not "O4"'),
    ("sac.target_entropy=automatic", 'sac.target_entropy: must be a number in [-1000, 1000] or auto, not "automatic"'),
    ("learner.hidden=64", "learner.hidden: must be a list of one or more, each a whole number in [1, 65536], not 64"),
    ("learner.hidden=[]", "learner.hidden: must be a list of one or more, each a whole number in [1, 65536], not []"),
    ("curriculum.stages=['']", "curriculum.stages: must be a list of one or more different values, each text, not"),
    ("curriculum.stages=[T1, T1]", "curriculum.stages: must be a list of one or more different values, each text, not"),
    ("name=42", "name: must be text of letters, digits and . _ -, not 42: put it in quotes"),
    ("name=../up", 'name: must be text of letters, digits and . _ -, not "../up"'),
    ("name='..'", 'name: must be text of letters, digits and . _ -, not ".."'),
    ("learner.count=3", "learner.batch_size = 256 cannot be shared out among learner.count = 3: use a multiple"),
    ("learner.device=gpu", 'learner.device: must be auto or cpu or cuda, not "gpu"'),
    ("learner.buffer_size=100", "learner.batch_size = 256 is more than learner.buffer_size = 100: lower it"),
    ("{learner: 1}=2", "unknown key"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "message"), BAD_SETS, ids=[text for text, _ in BAD_SETS])
def test_a_bad_set_is_named_in_one_line(text: str, message: str):
    with pytest.raises(ConfigError) as raised:
        load(sets=["seed=1", text])
    assert str(raised.value).startswith(f"--set {text}: ")
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)


BAD_FILES = [
    ("", 1, "is empty"),
    ("# only a comment\n", 1, "is empty"),
    ("name: a\nlearner:\n  gamma: 2\n", 3, "learner.gamma: must be a number in [0, 1], not 2"),
    ("name: a\nlearner:\n  gama: 2\n", 3, "learner.gama: unknown key: did you mean learner.gamma?"),
    ("name: a\nname: b\n", 2, "name: already set at"),
    ("- a\n- b\n", 1, "the file is a list or a scalar"),
    ("name: [a\nseed: 1\n", 2, "is not valid YAML"),
    ("learner:\n\tgamma: 1\n", 2, "is not valid YAML"),
    ("learner: &a\n  gamma: *b\n", 2, "is not valid YAML: found undefined alias"),
    ("learner: &a\n  learner: *a\n", 1, "holds more than 100,000 values"),
    (
        "learner:\n  batch_size: 300\n  buffer_size: 200\n",
        3,
        "learner.batch_size = 300 is more than learner.buffer_size = 200",
    ),
    ("name: a\n---\nname: b\n", 2, "is not valid YAML"),
]


@pytest.mark.parametrize(("text", "line", "message"), BAD_FILES)
def test_a_bad_file_is_named_with_its_line(tmp_path: Path, text: str, line: int, message: str):
    path = written(text, tmp_path)
    with pytest.raises(ConfigError) as raised:
        load([path])
    assert str(raised.value).startswith(f"{path}:{line}: ")
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)


def test_learners_have_equal_shares_of_what_the_algorithm_updates_with():
    assert load(sets=["learner.count=3", "learner.batch_size=258"])["learner"]["count"] == 3
    assert load(sets=["learner.count=3", "algorithm=ppo", "ppo.minibatch_size=63"])["learner"]["count"] == 3
    with pytest.raises(ConfigError, match=r"^--set algorithm=ppo: ppo.minibatch_size = 64 cannot be shared out"):
        load(sets=["learner.count=3", "learner.batch_size=258", "algorithm=ppo"])


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path):
    (tmp_path / "latin.yaml").write_bytes("name: \xe9".encode("latin-1"))
    for path, message in (
        (tmp_path / "missing.yaml", "cannot be read (No such file or directory)"),
        (tmp_path / "latin.yaml", "is not UTF-8 text"),
        (tmp_path, "cannot be read (Is a directory)"),
        ("train_smok", "no such configuration: use a path ending in .yaml, or one of "),
    ):
        with pytest.raises(ConfigError) as raised:
            load([path])
        assert str(raised.value).startswith(f"{path}: {message}")


def test_deep_nesting_is_refused_not_crashed(tmp_path: Path):
    with pytest.raises(ConfigError, match=r"is not valid YAML|must be"):
        load([written("name: " + "[" * 5000, tmp_path)])


@pytest.mark.slow
def test_bounds_are_part_of_the_range():
    for key, field in SCHEMA.items():
        if field.kind in (int, float) and not field.many and math.isfinite(field.low):
            extra = [f"{small}=1" if key == large else f"{large}={SCHEMA[large].high!r}" for small, large in AT_MOST]
            for bound in (field.low, field.high):
                load(sets=[*extra, f"{key}={bound!r}"])
            with pytest.raises(ConfigError, match=key):
                load(sets=[*extra, f"{key}={field.high * 2!r}"])
