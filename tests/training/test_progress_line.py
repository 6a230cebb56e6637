"""A training whose output nobody takes any more is told so between two iterations, and not in the middle of one."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from envs.errors import FAILED
from freemesh_ray.formatting.terminal import PIPE_CLOSED
from freemesh_ray.training.progress_line import ProgressLine


@pytest.mark.parametrize(("device", "code"), [("pipe", PIPE_CLOSED), ("/dev/full", FAILED)])
def test_lost_output_is_remembered_and_raises_nothing(device: str, code: int) -> None:
    reader, writer = os.pipe() if device == "pipe" else (os.open(os.devnull, os.O_RDONLY), os.open(device, os.O_WRONLY))
    os.close(reader)
    with open(writer, "w") as stream:
        line = ProgressLine(stream)
        assert line.lost is None
        for _ in range(3):
            line.on_note("interrupted: \x1b[2J")
        assert line.lost is not None
        assert line.lost.exit_code == code


def test_notes_hold_no_commands_to_the_terminal(tmp_path: Path) -> None:
    with open(tmp_path / "log", "w+", encoding=sys.getdefaultencoding()) as stream:
        ProgressLine(stream).on_note("\x1b[2J: two\nlines")
        stream.seek(0)
        assert stream.read() == "\\x1b[2J: two\nlines\n"
