"""A module says once what a name of it is: of two meanings, as a merge may leave them, the first is lost in silence."""

from __future__ import annotations

import ast
from collections import Counter

import pytest
from checkout import ROOT


def said_again(source: str) -> list[str]:
    """The names that a module binds more than once on its own level, outside of alternatives."""
    bound: Counter[str] = Counter()
    for node in ast.parse(source).body:
        match node:
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                bound[node.name] += not any("overload" in ast.unparse(each) for each in node.decorator_list)
            case ast.Assign() | ast.AnnAssign():
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                bound.update({each.id for target in targets for each in ast.walk(target) if isinstance(each, ast.Name)})
    return [name for name, times in bound.items() if times > 1]


@pytest.mark.slow
def test_no_name_of_a_module_is_said_again() -> None:
    twice = "A = 1\nB, C = 2, 3\nA = 2\ndef f(): x = 1; x = 2\nclass C: pass\nif A:\n    D = 1\nelse:\n    D = 2\n"
    assert said_again(twice) == ["A", "C"]
    for package in ("envs", "freemesh_ray", "tests"):
        for path in sorted((ROOT / package).rglob("*.py")):
            assert said_again(path.read_text()) == [], path.relative_to(ROOT)
