"""Pictures that move: a window, and videos, with the extra `play`; without it one line that names it."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from fake_pygame import FakePygame
from gymnasium.error import DependencyNotInstalled
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import RecordVideo, vector

from envs.mesh_env import MeshEnv

ACTIONS = np.random.default_rng(2).uniform(-1.0, 1.0, (8, 3)).astype(np.float32)


@pytest.fixture
def pygame(monkeypatch: pytest.MonkeyPatch) -> FakePygame:
    fake = FakePygame()
    monkeypatch.setitem(sys.modules, "pygame", fake)
    return fake


@pytest.mark.filterwarnings("error")
def test_a_window_shows_what_is_drawn(pygame: FakePygame) -> None:
    """After a reset and every step, columns first as pygame has them, at the environment's pace."""
    env, drawn = gym.make("envs:FreeMesh-v0", render_mode="human"), MeshEnv(render_mode="rgb_array")
    expected = []
    env.reset(seed=1), drawn.reset(seed=1)
    expected.append(drawn.render())
    for action in ACTIONS:
        env.step(action), drawn.step(action)
        expected.append(drawn.render())
    assert env.render() is None
    for shown, picture in zip(pygame.shown, expected, strict=True):
        np.testing.assert_array_equal(shown.swapaxes(0, 1), picture)
    assert len({picture.tobytes() for picture in expected}) > 2
    assert set(pygame.ticks) == {10}
    assert pygame.open
    env.close()
    assert not pygame.open


def test_without_pygame_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(DependencyNotInstalled) as error:
        gym.make("envs:FreeMesh-v0", render_mode="human")
    assert str(error.value) == "render_mode='human' needs pygame: pip install 'freemesh-ray[play]'"


def test_without_a_screen_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pygame", FakePygame("offscreen"))
    monkeypatch.delenv("SDL_VIDEODRIVER", raising=False)
    with pytest.raises(DependencyNotInstalled, match=r"^.*needs a screen.*use render_mode='rgb_array'$"):
        MeshEnv(render_mode="human")
    monkeypatch.setenv("SDL_VIDEODRIVER", "offscreen")  # asked for
    MeshEnv(render_mode="human").close()


def test_a_real_window(monkeypatch: pytest.MonkeyPatch) -> None:
    pygame = pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    check_env(gym.make("envs:FreeMesh-v0", render_mode="human").unwrapped)
    env, drawn = MeshEnv(render_mode="human"), MeshEnv(render_mode="rgb_array")
    for each in (env, drawn):
        each.reset(seed=1)
        for action in ACTIONS:
            each.step(action)
    on_screen = pygame.surfarray.array3d(pygame.display.get_surface())
    np.testing.assert_array_equal(on_screen.swapaxes(0, 1), drawn.render())
    env.close()


@pytest.fixture
def videos(monkeypatch: pytest.MonkeyPatch) -> list[tuple[list[np.ndarray], float]]:
    """The frames, and frames a second, that moviepy is given."""
    written: list[tuple[list[np.ndarray], float]] = []

    class ImageSequenceClip:
        def __init__(self, frames: list[np.ndarray], fps: float) -> None:
            written.append((list(frames), fps))

        def write_videofile(self, path: str, logger: Any = None) -> None:
            Path(path).touch()

    for name in ("moviepy", "moviepy.video", "moviepy.video.io", "moviepy.video.io.ImageSequenceClip"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    sys.modules["moviepy.video.io.ImageSequenceClip"].ImageSequenceClip = ImageSequenceClip  # type: ignore[attr-defined]
    return written


def record(env: RecordVideo | vector.RecordVideo, actions: np.ndarray) -> None:
    env.reset(seed=1)
    for action in actions:
        env.step(action)
    env.close()


@pytest.mark.slow
def test_a_video_has_every_step(videos: list[tuple[list[np.ndarray], float]], tmp_path: Path) -> None:
    env = gym.make("envs:FreeMesh-v0", render_mode="rgb_array")
    record(RecordVideo(env, str(tmp_path), disable_logger=True), ACTIONS)
    ((frames, fps),) = videos
    assert (len(frames), fps) == (len(ACTIONS) + 1, 10)
    drawn = MeshEnv(render_mode="rgb_array")
    drawn.reset(seed=1)
    np.testing.assert_array_equal(frames[0], drawn.render())
    for frame, action in zip(frames[1:], ACTIONS, strict=True):
        drawn.step(action)
        np.testing.assert_array_equal(frame, drawn.render())


@pytest.mark.slow
def test_a_batch_is_one_video(videos: list[tuple[list[np.ndarray], float]], tmp_path: Path) -> None:
    """A tile for each environment."""
    env = gym.make_vec("envs:FreeMesh-v0", num_envs=4, render_mode="rgb_array")
    record(vector.RecordVideo(env, str(tmp_path), video_length=3, disable_logger=True), np.stack([ACTIONS] * 4, axis=1))
    assert videos
    assert {frame.shape for frames, _ in videos for frame in frames} == {(1024, 1024, 3)}


def test_a_real_video(tmp_path: Path) -> None:
    pytest.importorskip("moviepy")
    env = gym.make("envs:FreeMesh-v0", render_mode="rgb_array")
    record(RecordVideo(env, str(tmp_path), disable_logger=True), ACTIONS)
    (path,) = tmp_path.iterdir()
    assert path.suffix == ".mp4"
    assert path.stat().st_size > 1000
