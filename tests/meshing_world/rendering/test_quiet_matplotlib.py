"""Where the home folder cannot be written to, importing pictures prints nothing; other messages of matplotlib stay."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
from pathlib import Path

import pytest
from checkout import ROOT

import envs.rendering

#: Variables that tell matplotlib where its cache may be.
PLACES = ("MPLCONFIGDIR", "XDG_CACHE_HOME", "XDG_CONFIG_HOME")


@pytest.mark.slow
@pytest.mark.parametrize("module", ["envs.rendering.frame", "freemesh_ray.plots.page", "freemesh_ray.report.pictures"])
def test_nothing_is_said_of_a_temporary_cache(module: str, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    told = {key: value for key, value in os.environ.items() if key not in PLACES}
    told |= {"HOME": str(tmp_path / "file" / "home"), "PYTHONPATH": str(ROOT)}
    line = [sys.executable, "-c", f"import {module}"]
    done = subprocess.run(line, env=told, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout + done.stderr == ""


def test_other_messages_are_shown(caplog: pytest.LogCaptureFixture) -> None:
    assert envs.rendering
    logging.getLogger("matplotlib").warning("a font is missing")
    assert caplog.messages == ["a font is missing"]
