"""From the name of a plug-in to what it names: any object, a function, or a class of a kind."""

from __future__ import annotations

import difflib
import importlib
import importlib.util
import re
import sys
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

from envs.errors import PluginError
from envs.plug_ins.named_object import PlugIn, told
from envs.plug_ins.search_path import findable

#: What names a plug-in.
SPEC = r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*(\.[^\W\d]\w*)*"


def is_spec(text: object) -> bool:
    """Whether a text names a plug-in."""
    return isinstance(text, str) and re.fullmatch(SPEC, text) is not None


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


def _module(name: str, key: str, spec: str) -> ModuleType:
    """Import a plug-in's module."""
    found = findable(name.partition(".")[0], key, spec)
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


def _kind(value: Any) -> str:
    """What an object is, in words."""
    if isinstance(value, type):
        return f"the class {value.__name__}"
    return "a function" if callable(value) and hasattr(value, "__code__") else f"of type {type(value).__name__}"
