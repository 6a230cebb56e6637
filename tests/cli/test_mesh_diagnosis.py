"""``freemesh mesh --diagnose``: a list, a picture and an exit code, also of what readers refuse."""

from __future__ import annotations

from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from freemesh_ray.cli import command as cli
from freemesh_ray.plots.diagnosis_plot import APART, free_spot


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def diagnosed(text: str, capsys: pytest.CaptureFixture[str], *options: str, name: str = "part.wkt") -> tuple[int, str]:
    Path(name).write_text(text)
    code = cli.main(["mesh", name, "--diagnose", "wrong.png", *options])
    assert matplotlib.image.imread("wrong.png").std() > 0.0
    return code, capsys.readouterr().out


def test_nothing_is_wrong(capsys: pytest.CaptureFixture[str]) -> None:
    code, out = diagnosed("POLYGON((0 0,4 0,4 4,0 4,0 0))", capsys)
    assert (code, out) == (0, "part.wkt: nothing is wrong\n")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("POLYGON((0 0,2 2,2 0,0 2,0 0))", "crossing  (1, 1)"),
        ("POLYGON((0 0,4 0,4 4,0 0))", "at least 4 are needed"),
        ("POLYGON((0 0,4 0,4 2,2 3,0 2,0 0))", "--fix-parity"),
        ("POLYGON((0 0,4 0,4 2,0 2,0 0),(1.9 0.9,2.1 0.9,2.1 1.1,1.9 1.1,1.9 0.9))", "--edge-length 0.2"),
        ("MULTIPOLYGON(((0 0,2 0,2 2,0 2,0 0)),((1 1,3 1,3 3,1 3,1 1)))", "overlap  (1.5, 1.5)"),
    ],
)
def test_what_is_wrong_is_listed_and_drawn(text: str, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    code, out = diagnosed(text, capsys)
    assert code == 1
    assert words in out


def test_a_drawing_that_does_not_close(capsys: pytest.CaptureFixture[str]) -> None:
    """The reader refuses it; what was drawn is known all the same."""
    svg = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 40 20"><path d="M0 0H40V20H0V0.01" fill="none"/></svg>'
    code, out = diagnosed(svg, capsys, name="part.svg")
    assert code == 1
    assert "open ends are 0.01 apart" in out
    assert "--join" in out


def test_what_has_no_coordinates_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    Path("part.wkt").write_text("POLYGON((")
    assert cli.main(["mesh", "part.wkt", "--diagnose", "wrong.png"]) == 2
    assert not Path("wrong.png").exists()


def test_numbers_do_not_lie_upon_each_other() -> None:
    box = np.array([0.0, 0.0, 400.0, 300.0])
    places, taken = np.random.default_rng(0).random((25, 2)) * [400.0, 300.0], []
    for place in places:
        taken.append(free_spot(place, [*taken, *places], box, place - box[2:] / 2))
    apart = np.linalg.norm(np.array(taken)[:, None] - np.array(taken)[None], axis=2) + np.eye(25) * 1e9
    assert apart.min() >= 0.9 * APART
