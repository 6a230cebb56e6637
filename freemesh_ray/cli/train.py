"""``freemesh train``: one training, and the meshes of its best policy."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from envs.errors import INTERRUPTED
from freemesh_ray.cli.arguments import add_command, add_settings
from freemesh_ray.formatting.terminal import say

if TYPE_CHECKING:
    from freemesh_ray.training.run import Run

EPILOG = """\
examples:
  freemesh train --config train_default.yaml --resume
  freemesh train --set name=try --set curriculum.stages='[T1]' --set budget.minutes=5

Files named without a folder are looked for in tune_configs, too. Every key and its meaning stands in
tune_configs/defaults.yaml. Ctrl-C saves a checkpoint; the same command with --resume goes on from it.
"""

COLUMNS = (
    ("elements", "elements", ".0f"),
    ("eta", "eta", ".3f"),
    ("eta_p5", "eta p5", ".3f"),
    ("eta_min", "eta min", ".3f"),
    ("singularity", "irregular", ".0f"),
    ("scaled_jacobian", "scaled Jac.", ".3f"),
    ("triangles", "triangles", ".0f"),
)


def add(commands: Any) -> None:
    """Add the command to the grammar."""
    train = add_command(
        commands,
        "train",
        "train a policy",
        "Train a policy, keep the best one, and mesh every training domain with it.",
        EPILOG,
    )
    train.add_argument(
        "--config", action="append", default=[], metavar="FILE", help="YAML overlay on the defaults; repeatable"
    )
    add_settings(train, "of the training")
    train.add_argument("--resume", action="store_true", help="go on from the run's last checkpoint, if there is one")


def run(options: argparse.Namespace) -> int:
    """Train, and print what came of it.

    Raises:
        ConfigError, DomainError, RunError, CheckpointError: what is wrong with the input.
        TrainingError: the training failed.
    """
    from freemesh_ray import config
    from freemesh_ray.api.run_training import run as train
    from freemesh_ray.config.paths import Paths
    from freemesh_ray.training.progress_line import ProgressLine

    settings = Paths.from_environment().resolved(config.load(options.config, options.set))
    result = train(settings, [ProgressLine()], options.resume, lambda session: session.end("interrupted", INTERRUPTED))
    say(train_table(result, settings))
    return 0


def train_table(run: Run, config: Mapping[str, Any]) -> str:
    """What a training ends with."""
    from freemesh_ray.config.paths import pasted
    from freemesh_ray.formatting.table import duration, table
    from freemesh_ray.tracking import browsing, page

    rows = [
        [stage.domain, name, *(format(figures[key], form) if figures else "-" for key, _, form in COLUMNS)]
        for stage in run.stages
        for name, figures in (stage.figures or {"not completed": {}}).items()
    ]
    progress = run.progress
    lines = [
        "",
        table(["domain", "mesh", *(title for _, title, _ in COLUMNS)], rows, left=(0, 1)),
        "",
        f"trained {progress.env_steps:,} steps, {progress.updates:,} updates in {duration(progress.seconds)}"
        f" ({progress.updates / max(progress.seconds, 1e-9):.0f} updates/s)",
        f"best policy from step {progress.best_steps:,}",
        f"policy      {pasted(run.folder.policy)}",
        f"checkpoint  {pasted(run.checkpoint or '-')}",
        f"curve       {pasted(run.folder.curve)}",
    ]
    lines += [f"{stage.domain:<11} {pasted(stage.files[0]) if stage.files else stage.reason}" for stage in run.stages]
    for folder in {path.parent: None for stage in run.stages for path in stage.files}:
        lines.append(f"meshes      {pasted(folder)}")
    if config["tracking"]["enabled"]:
        shown = enumerate(browsing(config["tracking"]["uri"], page(run.folder.path)))
        lines += [f"{'' if i else 'compare':<11} {line}" for i, line in shown]
    return "\n".join(lines)
