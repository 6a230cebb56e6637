"""Two processes never train in one run folder: the second ends in one line, and leaves the folder as it was."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest
from test_training import Fails, Fake, run
from told import told

from freemesh_ray.cli import command
from freemesh_ray.storage.lock import FILE, InUseError
from freemesh_ray.training.job import prepare, train
from freemesh_ray.training.run_folder import RunFolder, TrainingError


def content(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in folder.rglob("*") if path.is_file() and path.name != FILE}


@pytest.mark.slow
def test_a_run_that_another_trains_is_left_alone(settings: dict[str, Any]) -> None:
    folder = RunFolder(Path(settings["paths"]["runs"]) / "fake")
    with folder.claimed(resume=True):
        # As a training that has evaluated and not yet saved leaves it.
        folder.evaluations.write_text('{"env_steps": 300}\n')
        before = content(folder.path)
        for resume in (True, False):
            with pytest.raises(InUseError, match=f"process {os.getpid()} on .*wait for its end, or --set name=OTHER"):
                run(settings, Fake(), resume=resume)
            with pytest.raises(InUseError):
                prepare(settings, resume)
        assert content(folder.path) == before
    assert run(settings, Fake()).progress.env_steps == 1000


def test_the_command_says_so_in_one_line_before_anything_is_started(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("freemesh_ray.local_ray.local_ray", None)
    with RunFolder(tmp_path / "twin").claimed(resume=True):
        line = ["train", "--config", "train_smoke", "--resume", "--set", "name=twin", "--set", f"paths.runs={tmp_path}"]
        assert command.main(line) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert err.startswith(f"freemesh: {tmp_path / 'twin'}: process {os.getpid()} on ")


@pytest.mark.slow
def test_a_training_holds_its_folder_until_it_ends_and_no_longer(settings: dict[str, Any]) -> None:
    folder, refused = RunFolder(Path(settings["paths"]["runs"]) / "fake"), []

    def report(status: object) -> None:
        try:
            with folder.claimed(resume=True):
                pass
        except InUseError:
            refused.append(status)

    settings["checkpoint"]["retries"] = 0
    with pytest.raises(TrainingError):
        train(settings, make=lambda _: Fails(700), callbacks=told(report=report))
    assert len(refused) == 6
    run(settings, Fake(), resume=True)
    with folder.claimed(resume=True):
        pass
