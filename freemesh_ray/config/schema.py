"""Every key of a configuration, and what it accepts."""

from __future__ import annotations

from dataclasses import replace

from envs.plug_ins.lookup import SPEC, is_spec, plug_in
from envs.plug_ins.named_object import PlugIn
from envs.types import COUNT, NAMED, SETTINGS, TINY
from freemesh_ray.config.algorithms import ALGORITHMS, Algorithm, Hyperparameter, settings_by_key
from freemesh_ray.config.field import Field

#: A place for files; a bucket is one where it is mounted.
FOLDER = Field(str, pattern=r"(?s)(?!\w[\w+.-]*://).*\S.*", hint="a folder, not a URL: mount the bucket")

#: A name, an address, or one of version 6 in brackets.
HOST = r"([\w.-]+|\[[0-9a-fA-F:.]+\])"

#: What a plug-in is named by.
PLUG_IN = Field(str, pattern=SPEC, hint="package.module:Name", optional=True)
PLUG_INS = replace(PLUG_IN, optional=False, many=True, empty=True)

#: Dotted key -> what it accepts. ``defaults.yaml`` holds the same keys, with their meaning and default.
SCHEMA: dict[str, Field] = {
    "name": Field(str, pattern=r"[A-Za-z0-9._-]*[A-Za-z0-9_-]", hint="text of letters, digits and . _ -"),
    "seed": Field(int, 0, 2**31 - 1),
    "algorithm": Field(str, words=tuple(ALGORITHMS), plug_in=True),
    "callbacks": replace(PLUG_INS, distinct=True),
    **{f"env.{name}": Field(str, words=tuple(numbers), optional=True) for name, numbers in NAMED.items()},
    **{f"env.{name}": Field(**vars(setting)) for name, setting in SETTINGS.items()},
    "env.reward": PLUG_IN,
    "env.observe": PLUG_IN,
    "env.wrappers": PLUG_INS,
    "curriculum.stages": Field(str, many=True, distinct=True),
    "curriculum.promote_at": Field(float, TINY, 1),
    "curriculum.window": Field(int, 1, 10**6),
    "curriculum.max_stage_steps": Field(int, 1, COUNT),
    "curriculum.rehearsal": Field(float, 0, 0.99),
    "learner.buffer_size": Field(int, 1, 10**9),
    "learner.batch_size": Field(int, 1, 10**6),
    "learner.gamma": Field(float, 0, 1),
    "learner.learning_rate": Field(float, TINY, 1),
    "learner.tau": Field(float, TINY, 1),
    "learner.n_step": Field(int, 1, 100),
    "learner.updates_per_step": Field(float, TINY, 100),
    "learner.normalise_observations": Field(bool),
    "learner.layer_norm": Field(bool),
    "learner.hidden": Field(int, 1, 65536, many=True),
    "learner.warmup_steps": Field(int, 1, 10**9),
    "learner.precision": Field(str, words=("float32", "bfloat16", "auto")),
    "learner.count": Field(int, 0, 64),
    "learner.device": Field(str, words=("auto", "cpu", "cuda")),
    **{key: setting.accepts for key, setting in settings_by_key(ALGORITHMS).items()},
    "runners.count": Field(int, 0, 1024, words=("auto",)),
    "runners.envs_per_runner": Field(int, 1, 4096),
    "runners.fragment": Field(int, 1, 10**5),
    "runners.overlap": Field(bool),
    "runners.timeout": Field(float, 1, 10**6),
    "budget.env_steps": Field(int, 1, COUNT),
    "budget.minutes": Field(float, TINY, 10**9, optional=True),
    "evaluation.interval": Field(int, 1, COUNT),
    "evaluation.episodes": Field(int, 1, 10**6),
    "evaluation.metrics": replace(PLUG_INS, distinct=True),
    "checkpoint.interval": Field(int, 1, COUNT),
    "checkpoint.keep": Field(int, 1, 1000),
    "checkpoint.retries": Field(int, 0, 1000),
    "tracking.uri": Field(
        str, pattern=rf"sqlite:///(?!:memory:).+|https?://{HOST}(:\d{{1,5}})?([/?#][^\s@]*)?", optional=True,
        hint="sqlite:///FILE or http://HOST:PORT",
    ),
    "tracking.experiment": Field(str),
    "tracking.enabled": Field(bool),
    "paths.runs": FOLDER,
    "paths.studies": FOLDER,
}  # fmt: skip

#: Keys that set several others: key -> name -> the values it sets. A later overlay, or a single key in the same file,
#: overrides them; the loaded tree holds the name whose values all stand in the end, else null.
SHORTHANDS: dict[str, dict[str, dict[str, float]]] = {
    f"env.{key}": {
        name: {f"env.{field}": number for field, number in numbers.items()} for name, numbers in names.items()
    }
    for key, names in NAMED.items()
}


def sections() -> tuple[str, ...]:
    """The sections of a configuration, in order."""
    return tuple(dict.fromkeys(key.split(".")[0] for key in SCHEMA if "." in key))


def register(name: str, algorithm: Algorithm) -> None:
    """Let ``algorithm: name`` be written in the configurations of this process, and a section ``name``.

    Args:
        name: a new one.
        algorithm: as those of ``ALGORITHMS``.
    """
    ALGORITHMS[name] = algorithm
    accepts = SCHEMA["algorithm"]
    SCHEMA["algorithm"] = replace(accepts, words=tuple(dict.fromkeys((*accepts.words, name))))
    _add_section(name, algorithm)


def _add_section(name: str, algorithm: Algorithm) -> None:
    SCHEMA.update((key, setting.accepts) for key, setting in settings_by_key({name: algorithm}).items())


def algorithm_name(setting: str) -> str:
    """The key in `ALGORITHMS`, and the section, of what ``algorithm`` is set to.

    A plug-in ``package.module:NAME`` is called ``name``; the first time it is imported, and gets its section.

    Raises:
        PluginError: it is no `Algorithm`, or there is another section of its name.
    """
    if not is_spec(setting):
        return setting
    found = plug_in(setting, "algorithm")
    name = found.name.lower()
    if name in ALGORITHMS and ALGORITHMS[name] == found.value:
        return name
    _check_algorithm(found)
    if name in ALGORITHMS or name in {key.partition(".")[0] for key in SCHEMA}:
        raise found.wrong(f"its section would be {name}, which is another's", "give it another name")
    ALGORITHMS[name] = found.value
    _add_section(name, found.value)
    return name


def _check_algorithm(found: PlugIn) -> None:
    """Refuse a plug-in that is no description of an algorithm.

    Raises:
        PluginError: as said.
    """
    entry = found.value
    if not isinstance(entry, Algorithm):
        raise found.wrong(f"is of type {type(entry).__name__}", "give an Algorithm of freemesh_ray.config")
    if not all(isinstance(setting, Hyperparameter) for setting in entry.settings.values()):
        raise found.wrong("has a setting without what it accepts", "give Hyperparameter(default, Field(...))")
    known = {*SCHEMA, *settings_by_key({found.name.lower(): entry})}
    for key in (entry.batch, entry.experience):
        if key not in known:
            raise found.wrong(f"draws from {key}, which is no setting", "name one")
