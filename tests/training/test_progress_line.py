"""The progress line as a callback: output that nobody takes any more interrupts a training between two iterations."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import pytest
from test_training import Fake, run

from envs.errors import FAILED
from freemesh_ray.formatting.terminal import PIPE_CLOSED, OutputLostError
from freemesh_ray.training import checkpoint
from freemesh_ray.training.progress_line import ProgressLine


@pytest.mark.parametrize(("device", "code"), [("pipe", PIPE_CLOSED), ("/dev/full", FAILED)])
def test_lost_output_interrupts_with_a_checkpoint(device: str, code: int, settings: dict[str, Any]) -> None:
    reader, writer = os.pipe() if device == "pipe" else (os.open(os.devnull, os.O_RDONLY), os.open(device, os.O_WRONLY))
    os.close(reader)
    with open(writer, "w") as stream, pytest.raises(OutputLostError) as lost:
        run(settings, Fake(), callbacks=[ProgressLine(stream)])
    assert lost.value.exit_code == code
    (saved,) = checkpoint.found(Path(settings["paths"]["runs"]) / "fake" / "checkpoints")
    assert saved.name == "step_000000100"


def test_notes_hold_no_commands_to_the_terminal(tmp_path: Path) -> None:
    with open(tmp_path / "log", "w+", encoding=sys.getdefaultencoding()) as stream:
        ProgressLine(stream).on_note("\x1b[2J: two\nlines")
        stream.seek(0)
        assert stream.read() == "\\x1b[2J: two\nlines\n"
