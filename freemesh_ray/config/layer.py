"""Overlays: the settings of one file, one part of a file or one ``--set``, each with its place."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Number
from pathlib import Path
from typing import Any

import yaml

from envs.printable import without_login
from freemesh_ray.config.document import composed, document, plain
from freemesh_ray.config.field import ConfigError
from freemesh_ray.config.schema import SCHEMA, algorithm_name, sections
from freemesh_ray.config.store_login import set_aside


@dataclass(frozen=True)
class Entry:
    """One setting as written: its dotted key, its value and the place, for messages."""

    key: str
    value: Any
    place: str


#: The settings of one file, one part of a file or one ``--set``; made by `file_layer`, `set_layer` and `tree_layer`.
Layer = Sequence[Entry]


def file_layer(source: str | Path) -> Layer:
    """The settings of one YAML file, as an overlay."""
    name, root = document(source)
    return tree_layer(root, name, 1)


def tree_layer(node: yaml.Node, name: str, line: int) -> Layer:
    """The settings of a YAML tree that begins on ``line`` of file ``name``, as an overlay.

    Raises:
        ConfigError: an unknown or repeated key.
    """
    return _unique(_entries(node, "", name, line))


def set_layer(text: str) -> Layer:
    """The settings of one ``key=value`` string, as an overlay."""
    key, equals, value = text.partition("=")
    place = f"--set {without_login(text)}"
    if not equals or not key.strip():
        raise ConfigError(f"{place}: is not key=value: write for example learner.gamma=0.95")
    return _unique(_entries(composed(value, place) or yaml.ScalarNode(_NULL, ""), key.strip(), place, line=None))


def know_algorithms(root: yaml.Node | None, sets: Sequence[str] = ()) -> None:
    """Import the algorithms of users' own that a YAML tree, or ``key=value`` strings, name: they have sections, too.

    To be called before the tree is read as layers.

    Raises:
        PluginError: one is none.
    """
    for text in sets:
        if text.partition("=")[0].strip() == ALGORITHM:
            _know(text.partition("=")[2].strip())
    left = [(root, False)] if root is not None else []
    while left:
        node, named = left.pop()
        if isinstance(node, yaml.ScalarNode) and named:
            _know(node.value)
        elif isinstance(node, yaml.MappingNode):
            left += [(value, named or key.value == ALGORITHM) for key, value in node.value]
        elif isinstance(node, yaml.SequenceNode):
            left += [(value, named) for value in node.value]


def _know(setting: str) -> None:
    algorithm_name(setting.strip("'\""))


_NULL = "tag:yaml.org,2002:null"
#: The setting whose plug-ins bring settings of their own.
ALGORITHM = "algorithm"
#: The setting whose address may hold a password.
STORE = "tracking.uri"


def value_layer(values: Mapping[str, Any], place: str) -> Layer:
    """Settings from Python, nested or by dotted key, as an overlay; ``place`` is where they come from, for messages.

    Tuples are lists, and NumPy's numbers Python's.

    Raises:
        ConfigError: an unknown or repeated key.
    """
    return _unique(_given(values, "", place))


def _given(value: Any, key: str, place: str) -> Iterator[Entry]:
    """Every setting in ``value``, which is given for ``key`` ("" for all)."""
    if key in SCHEMA:
        yield Entry(key, _python(value), place)
    elif key and key not in sections():
        raise ConfigError(f"{place}: {key}: unknown key{_nearest(key)}")
    elif isinstance(value, Mapping):
        for name, below in value.items():
            yield from _given(below, f"{key}.{name}" if key else str(name), place)
    else:
        raise ConfigError(f"{place}: {key}: is a section: give keys below it, for example {_example(key)}")


def _python(value: Any) -> Any:
    """A value as YAML would give it."""
    if isinstance(value, list | tuple):
        return [_python(each) for each in value]
    return value.item() if isinstance(value, Number) and hasattr(value, "item") else value


def values(layer: Layer) -> dict[str, Any]:
    """What an overlay sets, by dotted key, as written."""
    return {entry.key: entry.value for entry in layer}


def _entries(node: yaml.Node, key: str, place: str, line: int | None) -> Iterator[Entry]:
    """Every setting below ``node``, which is what stands at ``key`` ("" at the root), on ``line`` of a file."""
    here = place if line is None else f"{place}:{line}"
    if key in SCHEMA:
        yield Entry(key, _value(node, key, here), here)
    elif key and key not in sections():
        raise ConfigError(f"{here}: {key}: unknown key{_nearest(key)}")
    elif isinstance(node, yaml.MappingNode):
        for name, child in node.value:
            below = None if line is None else name.start_mark.line + 1
            yield from _entries(child, f"{key}.{name.value}" if key else str(name.value), place, below)
    elif not (key and node.tag == _NULL):  # a section with everything in it commented out is no mistake
        what = f"{key}: is a section" if key else "the file is a list or a scalar"
        raise ConfigError(f"{here}: {what}: write keys below it, for example {_example(key)}")


def _value(node: yaml.Node, key: str, place: str) -> Any:
    """The Python value of a node that stands at a key of the schema."""
    try:
        return plain(node, place)
    except ConfigError as error:
        raise ConfigError(f"{place}: {key}: must be {SCHEMA[key]}") from error


def _unique(entries: Iterator[Entry]) -> list[Entry]:
    """The entries of one layer, each key once, without the password of the tracking store."""
    found: dict[str, Entry] = {}
    for entry in entries:
        if entry.key in found:
            raise ConfigError(f"{entry.place}: {entry.key}: already set at {found[entry.key].place}: remove one")
        bare = entry.key == STORE and isinstance(entry.value, str)
        found[entry.key] = replace(entry, value=set_aside(entry.value)) if bare else entry
    return list(found.values())


def _nearest(key: str) -> str:
    """The known key that was probably meant, as the end of a message."""
    known = [*SCHEMA, *sections()]
    last = key.rpartition(".")[2]
    found = (
        difflib.get_close_matches(key, known, n=1, cutoff=0.75)
        or [name for name in SCHEMA if difflib.get_close_matches(last, [name.rpartition(".")[2]], cutoff=0.75)]
        or difflib.get_close_matches(key, known, n=1, cutoff=0.5)
    )
    return f": did you mean {found[0]}?" if found else f": known are name, seed, algorithm and {', '.join(sections())}"


def _example(key: str) -> str:
    """A line that would be right in section ``key``."""
    return next(known for known in SCHEMA if known.startswith(f"{key}." if key else "learner.")) + ": ..."
