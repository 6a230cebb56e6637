"""Plug-ins: what a user brings from a file of their own, named ``package.module:Name`` in a setting.

Modules are looked for where Python looks, then in the folders of `look_in`, which processes started from here know,
too. What goes wrong in a plug-in is a `PluginError`: one line with the setting, the plug-in, the place and the fix.
"""

from __future__ import annotations

import difflib
import hashlib
import importlib
import importlib.util
import math
import os
import re
import sys
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType
from typing import Any

from envs.errors import PluginError

#: What names a plug-in.
SPEC = r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*(\.[^\W\d]\w*)*"
#: The variable that tells processes started from here in which folders plug-ins were found.
FOLDERS = "FREEMESH_PLUG_INS"

#: Folders of `look_in`, in order.
_given: list[str] = []


@dataclass(frozen=True)
class PlugIns:
    """What of an environment is a user's own, by name.

    Attributes:
        reward: a function of a step.
        observe: a class of observations.
        wrappers: classes of Gymnasium wrappers, the innermost first.
    """

    reward: str | None = None
    observe: str | None = None
    wrappers: tuple[str, ...] = ()

    @property
    def alter(self) -> bool:
        """Whether a policy sees or does something else than in the environment as it is."""
        return bool(self.observe or self.wrappers)

    def __str__(self) -> str:
        named = {"env.reward": self.reward, "env.observe": self.observe, "env.wrappers": ", ".join(self.wrappers)}
        return ", ".join(f"{key} = {spec}" for key, spec in named.items() if spec)


#: An environment as it is.
NONE = PlugIns()


@dataclass(frozen=True)
class PlugIn:
    """A plug-in that was found.

    Attributes:
        key: the setting that names it.
        spec: its name.
        value: the object.
        file: that it stands in; empty where there is none.
    """

    key: str
    spec: str
    value: Any
    file: str = ""

    @property
    def name(self) -> str:
        """Its name without the module's."""
        return self.spec.rpartition(":")[2].rpartition(".")[2]

    def __call__(self, *arguments: Any) -> Any:
        """What it returns.

        Raises:
            PluginError: it raised; the line says what, and where.
        """
        try:
            return self.value(*arguments)
        except PluginError:
            raise
        except (Exception, SystemExit) as error:
            raise self.wrong(f"raised {told(error, self.file)}", "mend it") from error

    def number(self, *arguments: Any) -> float:
        """The number that it returns.

        Raises:
            PluginError: it raised, or returned anything else.
        """
        return self.as_number(self(*arguments))

    def as_number(self, value: Any) -> float:
        """A value that it returned.

        Raises:
            PluginError: it is not a finite number.
        """
        try:
            number = float(value)
        except (TypeError, ValueError):
            raise self.wrong(f"returned {value!r:.60}", "return a number") from None
        if not math.isfinite(number):
            raise self.wrong(f"returned {number}", "return a finite number")
        return number

    def wrong(self, what: str, fix: str) -> PluginError:
        """The error that says what is wrong with it."""
        return PluginError(f"{self.key}: {self.spec}: {what}: {fix}")


def is_spec(text: object) -> bool:
    """Whether a text names a plug-in."""
    return isinstance(text, str) and re.fullmatch(SPEC, text) is not None


def look_in(folder: str | Path) -> None:
    """Look for plug-ins in a folder, too, after all others."""
    path = str(Path(folder).expanduser().absolute())
    if path not in _given:
        _given.append(path)


def folders() -> tuple[str, ...]:
    """The folders of `look_in`, and those of the process that started this one."""
    inherited = [folder for folder in os.environ.get(FOLDERS, "").split(os.pathsep) if folder]
    return tuple(dict.fromkeys([*inherited, *_given]))


def plug_in(named: Any, key: str) -> PlugIn:
    """The plug-in of a setting.

    Args:
        named: ``package.module:Name``, or the object itself.
        key: the setting.

    Raises:
        PluginError: there is none of this name, or its module cannot be imported.
    """
    if not isinstance(named, str):
        spec = f"{getattr(named, '__module__', type(named).__module__)}:{getattr(named, '__qualname__', repr(named))}"
        return PlugIn(key, spec, named, getattr(sys.modules.get(spec.partition(":")[0]), "__file__", None) or "")
    if not is_spec(named):
        raise PluginError(f"{key}: {named!r:.60} names no plug-in: write package.module:Name")
    module_name, _, name = named.partition(":")
    module = _module(module_name, key, named)
    file = getattr(module, "__file__", None) or ""
    value: Any = module
    for part in name.split("."):
        try:
            value = getattr(value, part)
        except AttributeError:
            near = difflib.get_close_matches(part, dir(value), n=1)
            meant = f"did you mean {near[0]}?" if near else "check the name"
            raise PluginError(f"{key}: {named}: {file or module_name} has no {part}: {meant}") from None
    return PlugIn(key, named, value, file)


def function(named: Any, key: str, what: str) -> PlugIn:
    """The plug-in of a setting that takes a function.

    Raises:
        PluginError: as `plug_in`, or it is none.
    """
    found = plug_in(named, key)
    if not callable(found.value) or isinstance(found.value, type):
        raise found.wrong(f"is {_kind(found.value)}", f"give {what}")
    return found


def subclass(named: Any, key: str, base: type, what: str) -> PlugIn:
    """The plug-in of a setting that takes a class.

    Raises:
        PluginError: as `plug_in`, or it is none of ``base``.
    """
    found = plug_in(named, key)
    if not (isinstance(found.value, type) and issubclass(found.value, base)):
        raise found.wrong(f"is {_kind(found.value)}", f"give {what}")
    return found


def top(spec: str, key: str) -> Path | None:
    """The file, or the folder, of a plug-in's outermost module; None where it has none.

    Raises:
        PluginError: there is no such module.
    """
    name = spec.partition(":")[0].partition(".")[0]
    found = _findable(name, key, spec)
    if found is None or (found.origin in (None, "built-in", "frozen") and not found.submodule_search_locations):
        return None
    if found.submodule_search_locations:
        return Path(next(iter(found.submodule_search_locations)))
    return Path(str(found.origin))


def digest(specs: Sequence[str], key: str = "plug-ins") -> str:
    """A digest of the source of plug-ins: of each one's file, or of all files of its package.

    Raises:
        PluginError: there is no such module.
    """
    places = sorted({place for spec in specs if (place := top(spec, key)) is not None})
    files = [file for place in places for file in ([place] if place.is_file() else sorted(place.rglob("*.py")))]
    return hashlib.sha256(b"\0".join(file.read_bytes() for file in files)).hexdigest()


def told(error: BaseException, file: str = "") -> str:
    """An exception in one line: its type, what it says, and where: in ``file``, if it passed there."""
    lines = str(error).strip().splitlines()
    text = f"{type(error).__name__}: {lines[0][:160]}" if lines else type(error).__name__
    if isinstance(error, SyntaxError):
        return f"{type(error).__name__}: {error.msg} ({error.filename}:{error.lineno})"
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if file and frame.filename == file]
    return "".join([text, *(f" ({frame.filename}:{frame.lineno})" for frame in (own or frames)[-1:])])


def _module(name: str, key: str, spec: str) -> ModuleType:
    """Import a plug-in's module."""
    found = _findable(name.partition(".")[0], key, spec)
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name and (name == error.name or name.startswith(f"{error.name}.")):
            raise PluginError(f"{key}: {spec}: no module {error.name}: check the name") from None
        raise _unimportable(error, found, name, key, spec) from error
    except (Exception, SystemExit) as error:
        raise _unimportable(error, found, name, key, spec) from error


def _unimportable(error: BaseException, found: ModuleSpec | None, name: str, key: str, spec: str) -> PluginError:
    try:
        file = str((importlib.util.find_spec(name) or found).origin)  # type: ignore[union-attr]
    except Exception:  # a package above it cannot be imported
        file = str(found.origin) if found is not None else ""
    return PluginError(f"{key}: {spec}: to import it raised {told(error, file)}: mend the file")


def _findable(name: str, key: str, spec: str) -> ModuleSpec | None:
    """The outermost module of a plug-in, which Python can import from here on; None where it is imported already and
    says nothing of itself.

    Raises:
        PluginError: there is none.
    """
    if name in sys.modules:
        return sys.modules[name].__spec__
    importlib.invalidate_caches()
    if (found := importlib.util.find_spec(name)) is not None:
        return found
    for folder in folders():
        if (found := PathFinder.find_spec(name, [folder])) is not None:
            sys.path.append(folder)  # last: it hides nothing
            known = os.environ.get(FOLDERS, "").split(os.pathsep)
            os.environ[FOLDERS] = os.pathsep.join(dict.fromkeys([*filter(None, known), folder]))
            return found
    where = _given[0] if _given else os.getcwd()
    raise PluginError(f"{key}: {spec}: no module {name}: put {name}.py into {where}, or set PYTHONPATH to its folder")


def _kind(value: Any) -> str:
    """What an object is, in words."""
    if isinstance(value, type):
        return f"the class {value.__name__}"
    return "a function" if callable(value) and hasattr(value, "__code__") else f"of type {type(value).__name__}"
