"""Plug-ins are found by name; what is wrong with one is one line with the setting, the name, the place and the fix."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plugged import Write, modules

from envs.errors import BAD_INPUT, PluginError
from envs.plug_ins import lookup, source_files

NAME = st.from_regex(r"[a-zA-Z_]\w{0,6}(\.[a-zA-Z_]\w{0,6}){0,2}", fullmatch=True)


@pytest.fixture
def write(tmp_path: Path) -> Iterator[Write]:
    with modules(tmp_path) as write:
        yield write


@given(NAME, NAME)
def test_a_name_is_a_module_and_what_is_in_it(module: str, name: str) -> None:
    assert lookup.is_spec(f"{module}:{name}")
    for text in (module, f"{module}:", f":{name}", f"{module}:{name}:{name}", f"{module}: {name}", f"{module}/{name}"):
        assert not lookup.is_spec(text)


@pytest.mark.parametrize(
    "text", ["random:7", "part:7", "random:7_holes=1", "http://host:80", "C:\\part.dxf", "a.json", 7]
)
def test_what_settings_hold_besides_names_no_plug_in(text: object) -> None:
    assert not lookup.is_spec(text)


def test_an_object_is_found_in_a_folder_that_is_not_python_s_and_by_processes_started_from_here(write: Write) -> None:
    name = write("class A:\n    class B:\n        @staticmethod\n        def f(x):\n            return 2 * x\n")
    found = lookup.plug_in(f"{name}:A.B.f", "env.reward")
    assert (found(3), found.name) == (6, "f")
    assert found.file.endswith(f"{name}.py")
    line = f"from envs.plug_ins.lookup import plug_in; print(plug_in('{name}:A.B.f', 'env.reward')(4))"
    root = str(Path(lookup.__file__).parents[2])
    told = subprocess.run([sys.executable, "-c", line], cwd="/", env=os.environ | {"PYTHONPATH": root},
                          capture_output=True, text=True, timeout=60)  # fmt: skip
    assert told.stdout == "8\n", told.stderr


def test_a_plug_in_hides_no_module_of_python(write: Write, tmp_path: Path) -> None:
    (tmp_path / "json.py").write_text("def mine(): ...\n")
    lookup.plug_in(f"{write('X = 1')}:X", "env.reward")
    with pytest.raises(PluginError, match=r"json\W__init__\.py has no mine"):
        lookup.plug_in("json:mine", "env.reward")


@pytest.mark.parametrize(
    ("source", "name", "words"),
    [
        ("def shape(): ...", "shap", "has no shap: did you mean shape?"),
        (
            "import numpi",
            "f",
            "raised ModuleNotFoundError: No module named 'numpi' (FILE:1): mend the file",
        ),
        (
            "x = 1\nx.y",
            "f",
            "raised AttributeError: 'int' object has no attribute 'y' (FILE:2): mend the file",
        ),
        ("def f(:", "f", "to import it raised SyntaxError: invalid syntax (FILE:1): mend the file"),
        ("raise SystemExit(3)", "f", "to import it raised SystemExit: 3 (FILE:1): mend the file"),
        ("f = 3", "f", "is of type int: give a function of a step"),
        ("class f: ...", "f", "is the class f: give a function of a step"),
    ],
)
def test_what_cannot_be_had_is_one_line(source: str, name: str, words: str, write: Write, tmp_path: Path) -> None:
    module = write(source)
    with pytest.raises(PluginError) as caught:
        lookup.function(f"{module}:{name}", "env.reward", "a function of a step")
    line = str(caught.value)
    assert line.startswith(f"env.reward: {module}:{name}: ")
    assert line.endswith(words.replace("FILE", str(tmp_path / f"{module}.py")))
    assert "\n" not in line
    assert caught.value.exit_code == BAD_INPUT


def test_a_module_that_is_missing_says_where_to_put_it(write: Write, tmp_path: Path) -> None:
    for name in ("missing_module:f", "missing_module.below:f"):
        with pytest.raises(PluginError, match=f"no module missing_module: put missing_module.py into {tmp_path}"):
            lookup.plug_in(name, "env.reward")
    with pytest.raises(PluginError, match=r"no module json\.below: check the name"):
        lookup.plug_in("json.below:f", "env.reward")


def test_what_a_plug_in_raises_is_told_with_its_line(write: Write, tmp_path: Path) -> None:
    module = write("import numpy\n\ndef f(x):\n    return numpy.linalg.inv(x)\n\ndef g(x):\n    raise ValueError\n")
    with pytest.raises(PluginError) as caught:
        lookup.plug_in(f"{module}:f", "env.reward")(np.zeros((2, 2)))
    place = tmp_path / f"{module}.py"
    assert str(caught.value) == f"env.reward: {module}:f: raised LinAlgError: Singular matrix ({place}:4): mend it"
    with pytest.raises(PluginError, match=r"raised ValueError \(.*:7\): mend it"):
        lookup.plug_in(f"{module}:g", "env.reward")(0)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (np.nan, "returned nan"),
        (np.inf, "returned inf"),
        (None, "returned None"),
        ("a", "returned 'a'"),
        ([1, 2], r"returned \[1, 2\]"),
    ],
)
def test_only_finite_numbers_are_numbers(value: object, words: str) -> None:
    with pytest.raises(PluginError, match=words):
        lookup.plug_in(lambda: value, "env.reward").number()


def test_the_digest_is_that_of_the_source(write: Write, tmp_path: Path) -> None:
    module = write("X = 1")
    before = source_files.digest([f"{module}:X"])
    assert source_files.digest([f"{module}:X"]) == before
    (tmp_path / f"{module}.py").write_text("X = 2")
    assert source_files.digest([f"{module}:X"]) != before
    package = tmp_path / f"{module}_package"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "inner.py").write_text("X = 1")
    before = source_files.digest([f"{package.name}.inner:X"])
    (package / "other.py").write_text("Y = 1")
    assert source_files.digest([f"{package.name}.inner:X"]) != before
    assert source_files.top("math:pi", "env.reward") is None or source_files.top("math:pi", "env.reward").exists()
