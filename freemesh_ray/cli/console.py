"""What the command prints: a live progress line, and tables."""

from __future__ import annotations

import math
import shutil
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np

from envs.types import Domain
from freemesh_ray.config.paths import shown
from freemesh_ray.formatting.table import duration, number, table

if TYPE_CHECKING:  # a mesh needs no training
    from freemesh_ray.mesher.api import Mesh
    from freemesh_ray.training.job import Trained
    from freemesh_ray.training.loop import Status

#: Elements that it took more than the policy to find, by where they came from.
REMEDIES = ("next vertex", "wide", "filled")

#: Seconds between progress lines where the line cannot be overwritten (a pipe, a log file).
LOG_INTERVAL = 15.0


class Progress:
    """One line that is overwritten on a terminal, and written anew now and then elsewhere."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._live = stream.isatty()
        self._width = 0
        self._last = -math.inf

    def show(self, status: Status) -> None:
        """Show the figures."""
        line = (
            f"{status.stage}  step {status.env_steps:,}/{status.budget_steps:,}"
            f"  return {number(status.mean_return, '.1f')}  done {number(status.completion_rate, '.0%')}"
            f"  {status.updates_per_second:.0f} updates/s  {duration(status.seconds_left)} left"
        )
        if self._live:
            # A line that wraps could not be overwritten.
            line = line[: shutil.get_terminal_size().columns - 1]
            self._stream.write("\r" + line.ljust(self._width))
            self._width = len(line)
        elif time.monotonic() - self._last >= LOG_INTERVAL:
            self._stream.write(line + "\n")
            self._last = time.monotonic()
        self._stream.flush()

    def note(self, text: str) -> None:
        """A line that stays."""
        self.finish()
        self._stream.write(text + "\n")
        self._stream.flush()

    def finish(self) -> None:
        """End the live line."""
        if self._live and self._width:
            self._stream.write("\r" + " " * self._width + "\r")
            self._width = 0


COLUMNS = (
    ("elements", "elements", ".0f"),
    ("eta", "eta", ".3f"),
    ("eta_p5", "eta p5", ".3f"),
    ("eta_min", "eta min", ".3f"),
    ("singularity", "irregular", ".0f"),
    ("scaled_jacobian", "scaled Jac.", ".3f"),
    ("triangles", "triangles", ".0f"),
)


def train_table(trained: Trained, config: Mapping[str, Any]) -> str:
    """What a training ends with."""
    rows = [
        [
            entry.domain,
            "yes" if entry.mesh is not None else "no",
            *(format(entry.figures[key], form) if entry.figures else "-" for key, _, form in COLUMNS),
        ]
        for entry in trained.produced
    ]
    progress = trained.progress
    lines = [
        "",
        table(["domain", "completed", *(title for _, title, _ in COLUMNS)], rows),
        "",
        f"trained {progress.env_steps:,} steps, {progress.updates:,} updates in {duration(progress.seconds)}"
        f" ({progress.updates / max(progress.seconds, 1e-9):.0f} updates/s)",
        f"best policy from step {progress.best_steps:,}",
        f"policy      {shown(trained.policy)}",
        f"checkpoint  {shown(trained.checkpoint)}",
        f"curve       {shown(trained.curve)}",
    ]
    lines += [f"{entry.domain:<11} {'  '.join(map(shown, entry.files)) or entry.reason}" for entry in trained.produced]
    tracking = config["tracking"]
    if tracking["enabled"]:
        uri = shown(tracking["uri"])
        local = uri.startswith("sqlite")
        lines.append(f"compare     {f'.venv/bin/mlflow ui --backend-store-uri {uri}' if local else uri}")
    return "\n".join(lines)


def domain_table(domains: Sequence[Domain]) -> str:
    """The catalogue: vertices, holes, segment lengths and sharpest corner of each domain."""
    rows = []
    for domain in domains:
        ends = domain.points[domain.segments]
        lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        rows.append(
            [
                domain.name,
                str(len(domain.segments)),
                f"{lengths.sum():.2f}",
                f"{domain.area:.2f}",
                f"{lengths.max() / lengths.min():.2f}",
                f"{sharpest_corner(domain):.0f}°",
                "with a hole" if len(domain.ring) > len(domain.segments) else "",
            ]
        )
    header = ["domain", "vertices", "perimeter", "area", "longest/shortest", "sharpest", ""]
    return table(header, rows)


def sharpest_corner(domain: Domain) -> float:
    """The least angle inside the domain, degrees."""
    ahead = np.roll(domain.vertices, -1, axis=0) - domain.vertices
    behind = np.roll(domain.vertices, 1, axis=0) - domain.vertices
    turn = np.arctan2(ahead[:, 0] * behind[:, 1] - ahead[:, 1] * behind[:, 0], np.sum(ahead * behind, axis=1))
    return float(np.degrees(turn % (2 * np.pi)).min())


def mesh_line(mesh: Mesh, figures: Mapping[str, float], outputs: Sequence[Path]) -> str:
    """A line on a mesh that was written, with its ``quality()``, and one on what recovery it needed, if any."""
    made = mesh.made
    line = (
        f"{mesh.name}: {len(mesh.quads)} quads in {1e3 * made.seconds_finished:.0f} ms, "
        f"eta {figures['eta']:.3f} (5th percentile {figures['eta_p5']:.3f}, least {figures['eta_min']:.3f}), "
        f"{figures['singularity']:.0f} irregular nodes -> {', '.join(map(str, outputs))}"
    )
    helped = [f"{count} {source}" for source, count in made.sources.items() if count and source in REMEDIES]
    if made.detours:
        helped.append(f"{made.detours} detours")
    return f"{line}\n{' ' * len(mesh.name)}  recovery: {', '.join(helped)}" if helped else line
