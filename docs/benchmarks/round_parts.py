"""The parts of a training round, each measured alone: what the model of the cost is made of."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from round_cost import Costs

from freemesh_ray.bench.gpu import experience
from freemesh_ray.bench.ours_and_sb3 import BATCH_SIZE, ENVS, algorithm

#: Two sizes of each thing whose cost is a constant and a slope.
ENVIRONMENTS = (16, 128)
STEPS = 32
RUNNERS = 4
ANSWER_ROWS = (0, 50_000)
BATCHES = (64, 1_024)
UPDATES = 32
#: Transitions in the replay buffer: more than fit a processor's cache.
STORED = 300_000


def typical(
    call: Callable[[], object], seconds: float, at_least: int = 5, settle: Callable[[], object] | None = None
) -> float:
    """Median seconds of a call, repeated for so long; the first one, and ``settle`` after each, are not counted."""
    times: list[float] = []
    began = time.perf_counter()
    while len(times) <= at_least or time.perf_counter() - began < seconds:
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
        if settle is not None:
            settle()
    return float(np.median(times[1:]))


def line(small: tuple[float, float], large: tuple[float, float]) -> tuple[float, float]:
    """Constant and slope, neither below 0, of the line through two points (x, seconds)."""
    slope = max(0.0, (large[1] - small[1]) / (large[0] - small[0]))
    return max(0.0, small[1] - slope * small[0]), slope


def sampling(seconds: float) -> tuple[float, float]:
    """Seconds of one step in a runner: constant, and for each environment."""
    points = []
    for envs in ENVIRONMENTS:
        algo = algorithm(0, envs=envs)
        took = typical(partial(algo.env_runner.collect, STEPS), seconds)
        points.append((float(envs), took / STEPS))
        algo.stop()
    return line(*points)


def transport(algo: Any, seconds: float) -> tuple[float, float, float]:
    """Seconds of a call to remote runners: once, for each of them, and for each byte of the answers."""

    def asked(runners: int, rows: int) -> float:
        def answer(runner: Any) -> Any:
            if getattr(runner, "answer_rows", None) != rows:
                runner.answer_rows, runner.answer = rows, experience(rows)
            return runner.answer

        indices = list(range(1, runners + 1))
        return typical(
            lambda: algo.env_runner_group.foreach_env_runner(answer, local_env_runner=False, remote_worker_ids=indices),
            seconds,
        )

    one, all_, large = asked(1, ANSWER_ROWS[0]), asked(RUNNERS, ANSWER_ROWS[0]), asked(1, ANSWER_ROWS[1])
    latency, call = line((1.0, one), (float(RUNNERS), all_))
    return latency, call, max(0.0, large - one) / (ANSWER_ROWS[1] * transition_bytes())


def transition_bytes() -> int:
    """Of one transition's numbers."""
    return sum(column[0].nbytes for column in experience(1))


def replay(seconds: float) -> tuple[float, float]:
    """Seconds of storing a transition and of drawing one."""
    from freemesh_ray.algorithms.replay_buffer import ReplayBuffer

    rows, count = experience(STORED), UPDATES * BATCH_SIZE
    buffer = ReplayBuffer(2 * STORED, rows.obs.shape[1], rows.actions.shape[1], seed=0)
    buffer.add(rows)
    few = experience(ENVS * STEPS)
    drawing = typical(lambda: buffer.sample(count), seconds) / count
    return typical(lambda: buffer.add(few), seconds) / len(few), drawing


def updating(group: Any, learners: int, batch: int, seconds: float) -> float:
    """Seconds of one of ``UPDATES`` updates with ``batch`` rows in one call of a learner group."""
    from freemesh_ray.algorithms.off_policy import batch as as_batch
    from freemesh_ray.algorithms.off_policy import learner_shares

    parts = [as_batch(part) for part in learner_shares(experience(batch * UPDATES), UPDATES, max(1, learners))]
    given: dict[str, Any] = {"batches": parts} if learners else {"batch": parts[0]}
    return typical(lambda: group.update(timesteps={}, **given), seconds) / UPDATES


def update(seconds: float) -> tuple[float, float]:
    """Seconds of an update in the training's process: constant, and for each row."""
    points = []
    for batch in BATCHES:
        algo = algorithm(0, batch=batch)
        points.append((float(batch), updating(algo.learner_group, 0, batch, seconds)))
        algo.stop()
    return line(*points)


def reduction(seconds: float) -> float:
    """Seconds that the averaging of the gradients adds to an update: two learners, beside one with as many rows."""
    times = []
    for learners in (1, 2):
        batch = learners * BATCH_SIZE // 2
        algo = algorithm(0, learners=learners, batch=batch)
        times.append(updating(algo.learner_group, learners, batch, seconds))
        algo.stop()
    return max(0.0, times[1] - times[0])


def publishing(algo: Any, seconds: float, *, wait: bool) -> tuple[float, float]:
    """Seconds of sending new weights, once and for each runner, with or without waiting until the runners have them."""

    def send(runners: int, timeout: float | None) -> None:
        algo.env_runner_group.sync_weights(
            from_worker_or_learner_group=algo.learner_group,
            to_worker_indices=list(range(1, runners + 1)),
            inference_only=True,
            timeout_seconds=timeout,
        )

    def idle() -> None:
        algo.env_runner_group.foreach_env_runner(lambda runner: None, local_env_runner=False)

    def publish(runners: int) -> float:
        return typical(partial(send, runners, None if wait else 0.0), seconds, settle=idle)

    return line((1.0, publish(1)), (float(RUNNERS), publish(RUNNERS)))


def publishing_here(seconds: float) -> tuple[float, int]:
    """Seconds of new weights where the training's process samples, and their bytes."""
    algo = algorithm(0)
    took = typical(algo._publish, seconds)
    weights = sum(weight.nbytes + bias.nbytes for weight, bias in algo.actor_weights())
    algo.stop()
    return took, weights


def measure(seconds: float) -> Costs:
    """All parts, each for about so many seconds a size; Ray is up, with room for ``RUNNERS`` processes."""
    step_call, step_env = sampling(seconds)
    add_row, draw_row = replay(seconds)
    update_call, update_row = update(seconds)
    reduce = reduction(seconds)
    algo = algorithm(RUNNERS)
    latency, call, byte = transport(algo, seconds)
    publish_once, publish_runner = publishing(algo, seconds, wait=True)
    send_once, send_runner = publishing(algo, seconds, wait=False)
    algo.stop()
    publish_local, weights = publishing_here(seconds)
    return Costs(
        step_call, step_env, latency, call, byte, add_row, draw_row, update_call, update_row, reduce,
        publish_once, publish_runner, send_once, send_runner, publish_local, transition_bytes(), weights,
    )  # fmt: skip
