"""How training scales with env runners and learners: writes docs/scaling.md, .json and .png.

    .venv/bin/python docs/benchmarks/scaling.py --out docs

Measured are the parts of a round, whole training rounds (samples and updates a second) with and without overlap, and
the time to a return; a model made of the parts is held against the rounds, and says what more runners than this machine
has would give.
"""

from __future__ import annotations

import json
import math
import os
import platform
import sys
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import round_parts
import scaling_report
from round_cost import Costs, Round, Setup, enough, hides, most, round_of
from scaling_picture import draw_scaling
from script import run_script

from freemesh_ray import config
from freemesh_ray.bench.ours_and_sb3 import BATCH_SIZE, ENVS, FRAGMENT, RATIO, algorithm
from freemesh_ray.cli import arguments
from freemesh_ray.config.env_runner_count import ENOUGH, runner_count
from freemesh_ray.local_ray import local_ray
from freemesh_ray.storage.atomic import check_writable, replacing

#: Updates a step.
RATIOS = (RATIO, 1 / 16, 1 / 256)
#: Learners that are processes, each number with each of these numbers of runners.
LEARNERS, THEIR_RUNNERS = (1, 2), (1, 2)
#: Runners up to which rounds without overlap are measured, too.
WITHOUT_OVERLAP = 2
#: The return to reach, as the mean of so many training episodes. Measurements of ``QUICK`` seconds or less only try
#: whether all works: their return is one that is reached at once.
RETURN, QUICK_RETURN, EPISODES = -15.0, -1_000.0, 50
QUICK = 2.0
#: Seconds after which a training that has not reached it is given up.
PATIENCE = 90.0
SEED = 356
#: Numbers of runners, and settings, that the model is asked about.
FAR = (100, 1_000)
VARIANTS: dict[str, dict[str, float]] = {
    "as measured": {},
    "runners.fragment 64": {"fragment": 64},
    "updates_per_step 1/16": {"updates_per_step": 1 / 16},
    "updates_per_step 1/256": {"updates_per_step": 1 / 256},
    "updates_per_step 1/256, overlap false": {"updates_per_step": 1 / 256, "overlap": False},
    "updates_per_step 1/256, fragment 64": {"updates_per_step": 1 / 256, "fragment": 64},
    "learner.count 8": {"learners": 8},
    "learner.count 8, batch_size 2048, updates_per_step 1/16": {
        "learners": 8,
        "batch": 2048,
        "updates_per_step": 1 / 16,
    },
}


@dataclass(frozen=True)
class Case:
    """The settings of a training whose rounds are measured.

    Attributes:
        runners: remote env runners; 0: the training's process samples.
        learners: remote learners; 0: the training's process updates.
        updates_per_step, overlap: the settings of these names.
    """

    runners: int
    learners: int = 0
    updates_per_step: float = RATIO
    overlap: bool = True

    def __str__(self) -> str:
        """In words."""
        ratio = scaling_report.fraction(self.updates_per_step)
        told = f"runners: {self.runners}, learners: {self.learners}, updates a step: {ratio}"
        return told if self.overlap else f"{told}, without overlap"


@dataclass(frozen=True)
class Measured:
    """Whole training rounds of a case, after the warm-up.

    Attributes:
        case: as said.
        samples_per_second, updates_per_second: over all rounds.
    """

    case: Case
    samples_per_second: float
    updates_per_second: float


@dataclass(frozen=True)
class Reached:
    """One training, from its first round to the return.

    Attributes:
        runners: remote env runners; 0: the training's process samples.
        seconds: to the return; None: it was given up after ``PATIENCE`` seconds.
        env_steps, updates: then.
    """

    runners: int
    seconds: float | None
    env_steps: int
    updates: int


def chosen(updates_per_step: float) -> int:
    """The runners that ``runners.count: auto`` stands for on this machine."""
    return runner_count(config.load(sets=["runners.count=auto", f"learner.updates_per_step={updates_per_step}"]))


def counts(cores: int) -> list[int]:
    """Runners to measure: none, one, two, and doubled while there is a core for each."""
    return [0, 1, *(2**i for i in range(1, max(2, cores.bit_length())))]


def cases(cores: int, auto: Mapping[float, int]) -> list[Case]:
    """What is measured on a machine; ``auto``: the runners that it chooses, by updates a step."""
    beside = [
        Case(runners, updates_per_step=ratio, overlap=overlap)
        for ratio in RATIOS
        for runners in sorted({*counts(cores), auto[ratio]})
        for overlap in ((True, False) if 0 < runners <= WITHOUT_OVERLAP else (True,))
    ]
    return beside + [Case(runners, learners) for learners in LEARNERS for runners in THEIR_RUNNERS]


def progress(line: str) -> None:
    """Tell what is being measured."""
    print(f"{time.strftime('%H:%M:%S')}  {line}", file=sys.stderr, flush=True)


def rounds(case: Case, seconds: float) -> Measured:
    """Train for so long, once updates have begun."""
    algo = algorithm(case.runners, learners=case.learners, updates_per_step=case.updates_per_step, overlap=case.overlap)
    while not algo.updates:
        algo.training_step()
    for _ in range(3):  # new processes are slow at first
        algo.training_step()
    steps, updates, began = algo.env_steps, algo.updates, time.perf_counter()
    while time.perf_counter() - began < seconds:
        algo.training_step()
    took = time.perf_counter() - began
    algo.stop()
    return Measured(case, (algo.env_steps - steps) / took, (algo.updates - updates) / took)


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
    cores, auto = len(os.sched_getaffinity(0)), {ratio: chosen(ratio) for ratio in RATIOS}
    planned, racing = cases(cores, auto), sorted({0, auto[RATIO]})
    measured, reached, all_ = [], [], 1 + len(planned) + len(racing)
    with local_ray(max(round_parts.RUNNERS, *(case.runners + case.learners for case in planned))):
        progress(f"1 of {all_}: the parts of a round")
        costs = round_parts.measure(seconds / 4)
        for i, case in enumerate(planned, 2):
            progress(f"{i} of {all_}: training rounds, {case}")
            measured.append(rounds(case, seconds))
        for i, runners in enumerate(racing, 2 + len(planned)):
            progress(f"{i} of {all_}: the time to a return of {wanted:g}, runners: {runners}")
            reached.append(time_to_return(runners, wanted))
    progress("all is measured")
    found = summary(costs, measured, reached, auto, wanted=wanted, seconds=seconds, cores=cores)
    text = scaling_report.text(found)
    with replacing(files["json"]) as draft:
        draft.write_text(json.dumps(found, indent=1) + "\n")
    with replacing(files["md"]) as draft:
        draft.write_text(text)
    draw_scaling(*scaling_report.curves(found), files["png"])
    print(text)
    print(f"written: {', '.join(map(str, files.values()))}")


def summary(
    costs: Costs,
    measured: Sequence[Measured],
    reached: Sequence[Reached],
    auto: Mapping[float, int],
    *,
    wanted: float,
    seconds: float,
    cores: int,
) -> dict[str, object]:
    """All that was found, as it is written down: what was measured, and what the model says beside it and beyond."""
    here = Setup(1, ENVS, FRAGMENT, RATIO, BATCH_SIZE, cores=cores)
    far = []
    for label, changes in VARIANTS.items():
        setup = replace(here, cores=None, **changes)  # type: ignore[arg-type]
        for runners in FAR:
            far.append(
                {
                    "settings": label,
                    "changes": changes,
                    "runners": runners,
                    **told(round_of(costs, replace(setup, runners=runners))),
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
            {**asdict(one.case), "samples_per_second": one.samples_per_second,
             "updates_per_second": one.updates_per_second,
             "model": told(round_of(costs, replace(here, **asdict(one.case))))}
            for one in measured
        ],
        "hides": hides(costs, here),
        "enough": ENOUGH,
        "auto": [
            {"updates_per_step": ratio, "runners": runners, "wanted": math.ceil(ENOUGH / ratio),
             "hiding_runners": hides(costs, here) / ratio,
             "enough_runners": enough(costs, replace(here, updates_per_step=ratio))}
            for ratio, runners in auto.items()
        ],
        "return": {"wanted": wanted, "episodes": EPISODES, "seed": SEED, "patience": PATIENCE,
                   "reached": [asdict(one) for one in reached]},
        "far": far,
    }  # fmt: skip


def told(modelled: Round) -> dict[str, object]:
    """What the model says of a round, as it is written down."""
    return {
        "samples_per_second": modelled.samples_per_second,
        "updates_per_second": modelled.updates_per_second,
        "seconds": modelled.seconds,
        "shares": {part: modelled.share(part) for part in modelled.parts},
        "bottleneck": modelled.bottleneck,
        "hidden": modelled.hidden,
        "behind": list(modelled.behind),
    }


def main() -> None:
    """Parse the command line and measure."""
    parser = arguments.Parser(description="Measure how training scales, and write the page about it.")
    parser.add_argument("--out", required=True, type=Path, metavar="FOLDER", help="where scaling.* are written")
    parser.add_argument("--seconds", type=arguments.seconds, default=5.0, help="of each measurement (5)")
    options = parser.parse_args()
    write_scaling(options.seconds, options.out)


if __name__ == "__main__":
    run_script(main)
