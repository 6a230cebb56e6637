"""How training scales with env runners and learners: writes docs/scaling.md, .json and .png.

    python docs/benchmarks/scaling.py --out docs

Measured are whole training rounds (samples and updates a second), the time to a return, and the parts of a round; a
model made of the parts is held against the rounds, and says what more runners than this machine has would give.
"""

from __future__ import annotations

import json
import os
import platform
import sys
import time
from collections import deque
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import scaling_report
from round_cost import Costs, Setup, enough, most, round_of
from round_parts import measure
from scaling_picture import draw_scaling
from script import run_script

from freemesh_ray.bench.trainings import BATCH_SIZE, ENVS, FRAGMENT, RATIO, algorithm
from freemesh_ray.cli import arguments
from freemesh_ray.local_ray import local_ray
from freemesh_ray.storage.atomic import check_writable, replacing

RUNNERS, LEARNERS = (1, 2, 4, 8), (0, 1, 2)
#: The return to reach, as the mean of so many training episodes. Measurements of ``QUICK`` seconds or less only try
#: whether all works: their return is one that is reached at once.
RETURN, QUICK_RETURN, EPISODES = -15.0, -1_000.0, 50
QUICK = 2.0
#: Seconds after which a training that has not reached it is given up.
PATIENCE = 180.0
SEED = 356
#: Numbers of runners, and settings, that the model is asked about.
FAR = (100, 1_000)
VARIANTS: dict[str, dict[str, float]] = {
    "as measured": {},
    "runners.fragment 64": {"fragment": 64},
    "updates_per_step 1/16": {"updates_per_step": 1 / 16},
    "updates_per_step 1/256": {"updates_per_step": 1 / 256},
    "updates_per_step 1/256, fragment 64": {"updates_per_step": 1 / 256, "fragment": 64},
    "learner.count 8": {"learners": 8},
    "learner.count 8, batch_size 2048, updates_per_step 1/16": {
        "learners": 8,
        "batch": 2048,
        "updates_per_step": 1 / 16,
    },
}


@dataclass(frozen=True)
class Measured:
    """Whole training rounds, after the warm-up.

    Attributes:
        runners, learners: remote env runners, and remote learners (0: in the training's process).
        samples_per_second, updates_per_second: over all rounds.
    """

    runners: int
    learners: int
    samples_per_second: float
    updates_per_second: float


@dataclass(frozen=True)
class Reached:
    """One training, from its first round to the return.

    Attributes:
        runners: remote env runners.
        seconds: to the return; None: it was given up after ``PATIENCE`` seconds.
        env_steps, updates: then.
    """

    runners: int
    seconds: float | None
    env_steps: int
    updates: int


def progress(line: str) -> None:
    """Tell what is being measured."""
    print(f"{time.strftime('%H:%M:%S')}  {line}", file=sys.stderr, flush=True)


def rounds(runners: int, learners: int, seconds: float) -> Measured:
    """Train for so long, once updates have begun."""
    algo = algorithm(runners, learners=learners)
    while not algo.updates:
        algo.training_step()
    for _ in range(3):  # new processes are slow at first
        algo.training_step()
    steps, updates, began = algo.env_steps, algo.updates, time.perf_counter()
    while time.perf_counter() - began < seconds:
        algo.training_step()
    took = time.perf_counter() - began
    algo.stop()
    return Measured(runners, learners, (algo.env_steps - steps) / took, (algo.updates - updates) / took)


def time_to_return(runners: int, wanted: float) -> Reached:
    """Train until the mean return of the last ``EPISODES`` training episodes is ``wanted``."""
    algo, recent = algorithm(runners, seed=SEED), deque[float](maxlen=EPISODES)
    reached, began = False, time.perf_counter()
    while not reached and time.perf_counter() - began < PATIENCE:
        algo.training_step()
        recent.extend(episode.episode_return for episode in algo.finished)
        algo.finished.clear()
        reached = algo.updates > 0 and len(recent) == EPISODES and float(np.mean(recent)) >= wanted
    took = time.perf_counter() - began
    algo.stop()
    return Reached(runners, took if reached else None, algo.env_steps, algo.updates)


def write_scaling(seconds: float, folder: Path) -> None:
    """Measure all, write ``scaling.json``, ``scaling.md`` and ``scaling.png``, and print the tables.

    Args:
        seconds: of each measurement.
        folder: to write into.

    Raises:
        OutputError: the folder cannot be written to.
    """
    files = {suffix: folder / f"scaling.{suffix}" for suffix in ("json", "md", "png")}
    for path in files.values():
        check_writable(path, parents=True)
    wanted = RETURN if seconds > QUICK else QUICK_RETURN
    measured, reached = [], []
    with local_ray(max(RUNNERS) + max(LEARNERS)):
        progress("the parts of a round")
        costs = measure(seconds / 4)
        for learners in LEARNERS:
            for runners in RUNNERS:
                progress(f"training rounds with {runners} runners, {learners} learners")
                measured.append(rounds(runners, learners, seconds))
        for runners in RUNNERS:
            progress(f"the time to a return of {wanted:g} with {runners} runners")
            reached.append(time_to_return(runners, wanted))
    found = summary(costs, measured, reached, wanted, seconds)
    text = scaling_report.text(found)
    with replacing(files["json"]) as draft:
        draft.write_text(json.dumps(found, indent=1) + "\n")
    with replacing(files["md"]) as draft:
        draft.write_text(text)
    draw_scaling(*scaling_report.curves(found), files["png"])
    print(text)
    print(f"written: {', '.join(map(str, files.values()))}")


def summary(
    costs: Costs, measured: list[Measured], reached: list[Reached], wanted: float, seconds: float
) -> dict[str, object]:
    """All that was found, as it is written down: what was measured, and what the model says beside it and beyond."""
    cores = os.cpu_count() or 1
    here = Setup(1, ENVS, FRAGMENT, RATIO, BATCH_SIZE, cores=cores)
    beside = [round_of(costs, replace(here, runners=one.runners, learners=one.learners)) for one in measured]
    far = []
    for label, changes in VARIANTS.items():
        setup = replace(here, cores=None, **changes)  # type: ignore[arg-type]
        for runners in FAR:
            modelled = round_of(costs, replace(setup, runners=runners))
            far.append(
                {
                    "settings": label,
                    "changes": changes,
                    "runners": runners,
                    "samples_per_second": modelled.samples_per_second,
                    "updates_per_second": modelled.updates_per_second,
                    "seconds": modelled.seconds,
                    "shares": {part: modelled.share(part) for part in modelled.parts},
                    "bottleneck": modelled.bottleneck,
                    "most_samples_per_second": most(costs, setup),
                    "enough_runners": enough(costs, setup),
                }
            )
    return {
        "machine": {"cores": cores, "system": f"{platform.system()} {platform.machine()}"},
        "setup": {key: value for key, value in asdict(here).items() if key not in ("runners", "learners")},
        "seconds": seconds,
        "costs": asdict(costs),
        "rounds": [
            {**asdict(one), "modelled_samples_per_second": model.samples_per_second, "bottleneck": model.bottleneck}
            for one, model in zip(measured, beside, strict=True)
        ],
        "return": {"wanted": wanted, "episodes": EPISODES, "seed": SEED, "patience": PATIENCE,
                   "reached": [asdict(one) for one in reached]},
        "far": far,
    }  # fmt: skip


def main() -> None:
    """Parse the command line and measure."""
    parser = arguments.Parser(description="Measure how training scales, and write the page about it.")
    parser.add_argument("--out", required=True, type=Path, metavar="FOLDER", help="where scaling.* are written")
    parser.add_argument("--seconds", type=arguments.seconds, default=5.0, help="of each measurement (5)")
    options = parser.parse_args()
    write_scaling(options.seconds, options.out)


if __name__ == "__main__":
    run_script(main)
