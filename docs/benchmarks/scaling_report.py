"""What the measurement of scaling found, in words, tables and curves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from round_cost import MOVES, Costs, Setup, round_of

from freemesh_ray.formatting.table import markdown

Found = Mapping[str, Any]
#: What the parts measured alone are called, and what their numbers are multiplied by.
PARTS = (
    ("step_call", "one step of a runner's environments", 1e6, "µs"),
    ("step_env", "more for each environment", 1e6, "µs"),
    ("latency", "a call to remote processes", 1e3, "ms"),
    ("call", "more for each process that answers", 1e3, "ms"),
    ("byte", "more for each MB of answers or batches", 1e9, "ms"),
    ("add_row", "storing a transition", 1e6, "µs"),
    ("draw_row", "drawing a transition", 1e6, "µs"),
    ("update_call", "an update", 1e3, "ms"),
    ("update_row", "more for each 1,000 of its rows", 1e6, "ms"),
    ("reduce", "more with several learners", 1e3, "ms"),
    ("publish_once", "new weights", 1e3, "ms"),
    ("publish_runner", "more for each runner", 1e3, "ms"),
)
#: Numbers of runners along the curves.
RANGE = (1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1_024)

#: The page, with the names of what was found in braces.
TEXT = """\
# Scaling

`python docs/benchmarks/scaling.py --seconds {seconds:g} --out docs` measures this and writes this page, the numbers
behind it (scaling.json) and the picture. Machine: {cores} cores, {system}. Settings, unless others are named: SAC on
T1, {envs} environments a runner, fragments of {fragment} steps, {updates_per_step:g} updates a step, batch {batch},
on the CPU.

![samples a second against env runners](scaling.png)

## Whole training rounds

Samples and updates a second over {seconds:g} s of training after the warm-up, with everything a round does: sampling,
storing, updating, sending weights. Learners: 0 is the one in the training's process, others are processes with an
equal share of every minibatch each. All processes share the {cores} cores, so that what is above them mostly waits.
The model's number is made of parts that were measured alone (below), not fitted to these.

{rounds}

## Time to a return of {wanted:g}

From the first round, the warm-up included, until the mean return of the last {episodes} training episodes is reached;
one seed ({seed}), so that a difference between two lines may be luck.

{returns}

## The parts of a round

Each measured alone: the median of repeated calls. Constants and slopes are lines through two sizes. A call and its
answer go through Ray's object store on one machine: between machines the network's latency and bandwidth come on top.

{parts}

## The model

A round is one part after the other, because the code is: nothing is sampled while the learners update. With N runners
of E environments, fragments of F steps, U updates a step and batches of B, shared by L learners, S = N E F:

| part      | seconds                                                                                |
|-----------|----------------------------------------------------------------------------------------|
| sampling  | F (step + E environment), all runners at once                                          |
| transport | call + N answer + S bytes                                                              |
| replay    | S storing + U S B drawing                                                              |
| update    | U S (update + B / L row); with processes call + U S B bytes; with several U S averaging |
| publish   | weights + N runner: they are put into the object store once for all runners            |

Where processes share cores, sampling takes N / cores times as long, and updates L / cores times, if that is more than
once. The model assumes that runners take equally long (a round waits for the slowest), that nothing fails, that
memory holds, and that what one process does for N others grows with N.

## Beyond this machine

The model with a core for every process. `at most` is what no number of runners passes; the last column is how many
reach nine tenths of it.

{far}

{moves}
"""


def text(found: Found) -> str:
    """The report, in Markdown."""
    tables = {table.__name__: table(found) for table in (rounds, returns, parts, far, moves)}
    return TEXT.format(
        **{**found["setup"], **found["machine"], **found["return"], **tables, "seconds": found["seconds"]}
    )


def rounds(found: Found) -> str:
    """Measured and modelled, by runners and learners."""
    rows = [
        [
            str(one["runners"]), str(one["learners"]), f"{one['samples_per_second']:,.0f}",
            f"{one['updates_per_second']:,.0f}", f"{one['modelled_samples_per_second']:,.0f}",
            f"{one['modelled_samples_per_second'] / one['samples_per_second']:.2f}", one["bottleneck"],
        ]
        for one in found["rounds"]
    ]  # fmt: skip
    head = ["runners", "learners", "samples/s", "updates/s", "model: samples/s", "model / measured", "most of it is"]
    return markdown(head, rows)


def returns(found: Found) -> str:
    """Seconds to the return, by runners."""
    given_up = f"not in {found['return']['patience']:g}"
    rows = [
        [
            str(one["runners"]), given_up if one["seconds"] is None else f"{one['seconds']:.0f}",
            f"{one['env_steps']:,}", f"{one['updates']:,}",
        ]
        for one in found["return"]["reached"]
    ]  # fmt: skip
    return markdown(["runners", "seconds", "env steps", "updates"], rows)


def parts(found: Found) -> str:
    """Seconds of each part."""
    costs = found["costs"]
    rows = [[label, f"{costs[name] * scale:.3g} {unit}"] for name, label, scale, unit in PARTS]
    rows += [
        ["bytes of a transition", f"{costs['transition_bytes']:,}"],
        ["bytes of the policy's weights", f"{costs['weights_bytes']:,}"],
    ]
    return markdown(["part", "cost"], rows)


def far(found: Found) -> str:
    """What the model says of many runners."""
    names = list(found["far"][0]["shares"])
    rows = [
        [
            one["settings"], f"{one['runners']:,}", f"{one['samples_per_second']:,.0f}",
            f"{one['updates_per_second']:,.0f}", *(f"{one['shares'][name]:.0%}" for name in names),
            one["bottleneck"], f"{one['most_samples_per_second']:,.0f}", f"{one['enough_runners']:,.0f}",
        ]
        for one in found["far"]
    ]  # fmt: skip
    return markdown(
        ["settings", "runners", "samples/s", "updates/s", *names, "bottleneck", "at most", "90 % of it with"], rows
    )


def moves(found: Found) -> str:
    """What moves each part."""
    return markdown(["bottleneck", "what moves it"], [list(pair) for pair in MOVES.items()])


Points = list[tuple[float, float]]


def curves(found: Found) -> tuple[dict[str, tuple[Points, Points]], dict[str, Points]]:
    """What `draw_scaling` draws: by learners the measured and the modelled, and by settings the modelled.

    Each point is (runners, samples a second).
    """
    here: dict[str, tuple[Points, Points]] = {}
    for one in found["rounds"]:
        label = _learners(one["learners"])
        measured, modelled = here.setdefault(label, ([], []))
        measured.append((one["runners"], one["samples_per_second"]))
        modelled.append((one["runners"], one["modelled_samples_per_second"]))
    return here, {one["settings"]: _modelled(found, one["changes"]) for one in found["far"]}


def _modelled(found: Found, changes: Mapping[str, Any]) -> Points:
    """Samples a second along ``RANGE``, with other settings and a core for every process."""
    costs, settings = Costs(**found["costs"]), {**found["setup"], **changes, "cores": None}
    return [(float(n), round_of(costs, Setup(runners=n, **settings)).samples_per_second) for n in RANGE]


def _learners(count: int) -> str:
    if count == 0:
        return "learner in the training's process"
    return f"{count} learner process{'es' if count > 1 else ''}"
