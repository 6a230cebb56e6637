"""The examples of docs/python.md with tiny trainings."""

from __future__ import annotations

import ast
from typing import Any

from checkout import ROOT

FOLDER = ROOT / "docs" / "examples" / "python"
TINY = {
    "budget": {"env_steps": 700, "minutes": None}, "runners": {"count": 0, "envs_per_runner": 4},
    "learner": {"hidden": [8], "warmup_steps": 100, "batch_size": 16, "updates_per_step": 0.01},
    "evaluation": {"interval": 100, "episodes": 1}, "env.max_invalid": 10, "tracking.enabled": False,
}  # fmt: skip


def shrunk(name: str, **settings: Any) -> str:
    """The code of an example.

    Args:
        name: of its file.
        settings: beside those of `TINY`, which replace the example's budget.
    """
    code = ast.parse((FOLDER / name).read_text())
    found = [node for node in ast.walk(code) if isinstance(node, ast.Dict) and "curriculum.stages" in _keys(node)]
    (own,) = found
    kept = [(key, value) for key, value in zip(own.keys, own.values, strict=True) if "budget" not in ast.unparse(key)]
    tiny = ast.parse(repr(TINY | settings), mode="eval").body
    own.keys, own.values = [*(key for key, _ in kept), *tiny.keys], [*(value for _, value in kept), *tiny.values]
    return ast.unparse(code)


def _keys(node: ast.Dict) -> list[object]:
    return [key.value for key in node.keys if isinstance(key, ast.Constant)]
