"""YAML files: read with the places of what stands in them, and written."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import yaml

from freemesh_ray.config.field import ConfigError

#: Bytes of a file at most.
MOST_BYTES = 1_000_000

#: Values in a file at most, those that aliases repeat counted as often as they are repeated.
MOST_VALUES = 100_000


class _Numbers:
    """YAML 1.1 reads 3e-4 and 1e6 as text; here they are numbers, on the way in and on the way out."""

    TAG = "tag:yaml.org,2002:float"
    FORM = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+\Z")
    FIRST = tuple("-+.0123456789")


class _Loader(yaml.SafeLoader):
    pass


class _Dumper(yaml.SafeDumper):
    pass


_Loader.add_implicit_resolver(_Numbers.TAG, _Numbers.FORM, _Numbers.FIRST)
_Dumper.add_implicit_resolver(_Numbers.TAG, _Numbers.FORM, _Numbers.FIRST)


def shipped() -> list[str]:
    """Names of the configurations that ship with the package, without suffix."""
    return sorted(item.name.removesuffix(".yaml") for item in _folder().iterdir() if item.name.endswith(".yaml"))


def _folder() -> Any:
    return resources.files("tune_configs")


def document(source: str | Path) -> tuple[str, yaml.Node]:
    """A YAML file's name and its tree; a bare name without suffix is a file that ships with the package.

    Raises:
        ConfigError: a missing, empty or invalid file.
    """
    name = str(source)
    short = name.removesuffix(".yaml")
    bare = "/" not in name and not os.path.isfile(name) and (short in shipped() or not Path(name).suffix)
    if bare and short not in shipped():
        raise ConfigError(
            f"{name}: no such configuration: use a path ending in .yaml, or one of {', '.join(shipped())}"
        )
    try:
        place = _folder() / f"{short}.yaml" if bare else Path(name)
        # A pipe is not waited for, and a device has no end.
        with open(place, "rb", opener=lambda path, flags: os.open(path, flags | os.O_NONBLOCK)) as file:
            content = file.read(MOST_BYTES + 1) or b""
        text = content.decode("utf-8")
    except OSError as error:
        raise ConfigError(f"{name}: cannot be read ({error.strerror}): check the path") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{name}: is not UTF-8 text: save it as UTF-8") from error
    if len(content) > MOST_BYTES:
        raise ConfigError(f"{name}: is larger than {MOST_BYTES:,} bytes: give the keys that differ alone")
    root = composed(text, name)
    if root is None:
        raise ConfigError(f"{name}:1: is empty: list the keys that differ from the defaults, or leave the file out")
    return name, root


def composed(text: str, place: str) -> yaml.Node | None:
    """The YAML tree of ``text`` with its line numbers; None when it holds nothing.

    Raises:
        ConfigError: it is no YAML, or its aliases (``*name``) make more of it than it may have.
    """
    try:
        root = yaml.compose(text, Loader=_Loader)
    except (yaml.YAMLError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        line = f":{mark.line + 1}" if mark and not place.startswith("--set") else ""
        problem = getattr(error, "problem", None) or type(error).__name__
        raise ConfigError(f"{place}{line}: is not valid YAML: {problem}") from error
    if root is not None and _values(root, {}) > MOST_VALUES:
        line = "" if place.startswith("--set") else ":1"
        raise ConfigError(f"{place}{line}: holds more than {MOST_VALUES:,} values: write it without aliases (*name)")
    return root


def _values(node: yaml.Node, known: dict[int, float]) -> float:
    """How many values there are at and below a node, infinitely many where it holds itself."""
    if id(node) not in known:
        known[id(node)] = math.inf
        below = node.value if isinstance(node, yaml.CollectionNode) else []
        parts = [part for pair in below for part in pair] if isinstance(node, yaml.MappingNode) else below
        known[id(node)] = 1 + sum(_values(part, known) for part in parts)
    return known[id(node)]


def read_plain(path: Path) -> Any:
    """The plain value in a YAML file that this program wrote; None when it holds nothing.

    Raises:
        ConfigError: it cannot be read, or is no YAML.
    """
    _, root = document(path.resolve())
    return plain(root, str(path))


def plain(node: yaml.Node, place: str) -> Any:
    """The Python value of a node.

    Raises:
        ConfigError: it has none.
    """
    try:
        return _Loader("").construct_object(node, deep=True)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise ConfigError(f"{place}: has no value: {str(error).splitlines()[0]}") from error


def dump(config: Mapping[str, Any]) -> str:
    """The tree as YAML that `load` reads back to the same tree."""
    return yaml.dump(dict(config), Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=120)
