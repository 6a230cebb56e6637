"""What the measurement of scaling found, in words, tables and curves."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

from round_cost import MOVES, Costs, Setup, round_of
from scaling_picture import Here, Points

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
    ("send_once", "new weights", 1e3, "ms"),
    ("send_runner", "more for each runner", 1e3, "ms"),
    ("publish_once", "new weights, until the runners have them", 1e3, "ms"),
    ("publish_runner", "more for each runner, until it has them", 1e3, "ms"),
    ("publish_local", "new weights where the training's process samples", 1e3, "ms"),
)
#: Numbers of runners along the curves.
RANGE = (1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1_024)

#: The page, with the names of what was found in braces.
TEXT = """\
# Scaling

`.venv/bin/python docs/benchmarks/scaling.py --seconds {seconds:g} --out docs` measures this and writes this page, the
numbers behind it (scaling.json) and the picture. Machine: {cores} cores, {system}. Settings, unless others are named:
SAC on T1, {envs} environments a runner, fragments of {fragment} steps, {updates_per_step:g} updates a step,
batch {batch}, on the CPU.

![samples a second against env runners](scaling.png)

## Sampling beside learning

Samples and updates a second over {seconds:g} s of training after the warm-up, with everything a round does. The
learner is in the training's process. Runners are processes of their own, which sample the next round while the learner
updates (`runners.overlap`); with 0 runners the training's process samples, too. All share the {cores} cores: what is
above them waits. `(auto)` is the number that `runners.count: auto` chooses here. `of the fastest` compares with the
most samples a second at the same updates a step, `gain` with the line of fewer runners that overlap. The model's
number is made of parts that were measured alone (below), not fitted to these.

{beside}

At these updates a step `auto` has {worst:.0%} of the fastest's samples a second or more; two measurements of the same
may differ by a few percent.

How many runners it takes: a runner that does nothing else samples {samples:,.0f} steps a second, a learner that does
nothing else makes {updates:,.0f} updates. That is {hides:.2g} updates for each step: with so many a step, or more, the
sampling of one runner is hidden behind the updates, and with U a step that of {hides:.2g} / U runners. A few more still
help, as more steps share what a round costs once. `auto` takes {enough:g} / U, rounded up, and at most one for each
core beside the learner's. One runner spares the training's process {spared:.2g} ms of sampling a round, and costs it
{remote:.2g} ms more for answers and weights: the fewer updates a round has, the more that counts.

{choice}

## Several learners

With {updates_per_step:g} updates a step. Learners: 0 is the one in the training's process, others are processes
with an equal share of every minibatch each.

{learners}

## Time to a return of {wanted:g}

From the first round, the warm-up included, until the mean return of the last {episodes} training episodes is reached;
one seed ({seed}), so that a difference between two lines may be luck.

{returns}

## The parts of a round

Each measured alone: the median of repeated calls. Constants and slopes are lines through two sizes. A call and its
answer go through Ray's object store on one machine: between machines the network's latency and bandwidth come on top.

{parts}

## The model

With N runners of E environments, fragments of F steps, U updates a step and batches of B, shared by L learners,
S = N E F:

| part      | seconds                                                                                |
|-----------|----------------------------------------------------------------------------------------|
| sampling  | F (step + E environment), all runners at once                                          |
| transport | call + N answer + S bytes                                                              |
| replay    | S storing + U S B drawing                                                              |
| update    | U S (update + B / L row); with processes call + U S B bytes; with several U S averaging |
| publish   | weights + N runner: they are put into the object store once for all runners            |

The runners sample the next round while the learners update. So the shorter of sampling and update is hidden behind the
longer, and the training's process does the rest, one after the other:

    seconds of a round = transport + replay + publish + max(sampling, update)

Where processes share cores, sampling takes N / cores times as long, and updates L / cores times, if that is more than
once; and both together take no less than all their work divided by the cores: then only a share of the shorter one is
hidden. Without overlap a round is the sum of its parts, and publishing waits until the runners have the weights.
Without runners it is the sum, too, with E F steps and no transport.

The model assumes that runners take equally long (a round waits for the slowest), that nothing fails, that memory holds,
and that what one process does for N others grows with N.

## Beyond this machine

The model with a core for every process. Shares are of the seconds that a round takes: how long it waits for each part;
`hidden` is what it does not wait for. `at most` is what no number of runners passes; the last column is how many reach
nine tenths of it.

{far}

{moves}
"""


def text(found: Found) -> str:
    """The report, in Markdown."""
    tables = {table.__name__: table(found) for table in (beside, choice, learners, returns, parts, far, moves)}
    costs, setup = Costs(**found["costs"]), found["setup"]
    here, one = (round_of(costs, Setup(runners=n, **setup)).parts for n in (0, 1))
    return TEXT.format(
        **{**setup, **found["machine"], **found["return"], **tables},
        seconds=found["seconds"],
        hides=found["hides"],
        enough=found["enough"],
        worst=min(of_the_fastest(found, case) for case in found["rounds"] if is_auto(found, case)),
        samples=setup["envs"] / (costs.step_call + setup["envs"] * costs.step_env),
        spared=1e3 * here["sampling"],
        remote=1e3 * (one["transport"] + one["publish"] - here["publish"]),
        updates=1 / (costs.update_call + setup["batch"] * costs.update_row),
    )


def is_auto(found: Found, one: Found) -> bool:
    """Whether a measurement is of what ``runners.count: auto`` chooses."""
    runners = {auto["updates_per_step"]: auto["runners"] for auto in found["auto"]}
    return one["learners"] == 0 and one["overlap"] and one["runners"] == runners[one["updates_per_step"]]


def of_the_fastest(found: Found, one: Found) -> float:
    """Samples a second of a measurement over the most with as many updates a step, learners in the same place."""
    rivals = [
        rival["samples_per_second"]
        for rival in found["rounds"]
        if (rival["updates_per_step"], rival["learners"]) == (one["updates_per_step"], one["learners"])
    ]
    return float(one["samples_per_second"] / max(rivals))


def gain(found: Found, one: Found) -> float | None:
    """Samples a second of a measurement over those with the next fewer runners, overlapping where there are any."""
    fewer = [
        other
        for other in found["rounds"]
        if other["runners"] < one["runners"]
        and other["overlap"]
        and (other["updates_per_step"], other["learners"]) == (one["updates_per_step"], one["learners"])
    ]
    if not fewer or not one["overlap"]:
        return None
    return float(one["samples_per_second"] / max(fewer, key=lambda other: other["runners"])["samples_per_second"])


def beside(found: Found) -> str:
    """Measured and modelled where the training's process learns, by updates a step, runners and overlap."""
    rows = [
        [
            fraction(one["updates_per_step"]), f"{one['runners']}{' (auto)' * is_auto(found, one)}", overlap(one),
            *speeds(one), f"{of_the_fastest(found, one):.0%}",
            "-" if (times := gain(found, one)) is None else f"{times:.2f}", *modelled(one),
        ]
        for one in found["rounds"] if one["learners"] == 0
    ]  # fmt: skip
    head = ["updates a step", "runners", "overlap", "samples/s", "updates/s", "of the fastest", "gain", *MODELLED]
    return markdown(head, rows)


def choice(found: Found) -> str:
    """What ``runners.count: auto`` goes by."""
    rows = [
        [
            fraction(one["updates_per_step"]), f"{one['hiding_runners']:.2g}", f"{one['enough_runners']:,}",
            f"{one['wanted']:,}", f"{one['runners']:,}",
        ]
        for one in found["auto"]
    ]  # fmt: skip
    head = ["updates a step", "runners hidden behind updates", "90 % of the limit with", "auto, cores enough", "here"]
    return markdown(head, rows)


def learners(found: Found) -> str:
    """Measured and modelled with overlap and the usual updates a step, by learners and runners."""
    rows = [
        [str(one["learners"]), str(one["runners"]), *speeds(one), *modelled(one)]
        for one in sorted(found["rounds"], key=lambda one: (one["learners"], one["runners"]))
        if one["updates_per_step"] == found["setup"]["updates_per_step"] and one["overlap"] and one["runners"]
    ]
    return markdown(["learners", "runners", "samples/s", "updates/s", *MODELLED], rows)


#: The columns of `modelled`.
MODELLED = ("model: samples/s", "model / measured", "waits most for", "hidden")


def modelled(one: Found) -> list[str]:
    """What the model says beside a measurement."""
    model = one["model"]
    return [
        f"{model['samples_per_second']:,.0f}", f"{model['samples_per_second'] / one['samples_per_second']:.2f}",
        model["bottleneck"], hidden(model),
    ]  # fmt: skip


def hidden(model: Found) -> str:
    """Which part the round does not wait for, and behind which it is hidden."""
    shorter, longer = model["behind"]
    return f"{model['hidden']:.0%} of {shorter} behind {longer}" if model["hidden"] > 0 else "-"


def speeds(one: Found) -> list[str]:
    """Samples and updates a second."""
    return [f"{one['samples_per_second']:,.0f}", f"{one['updates_per_second']:,.0f}"]


def overlap(one: Found) -> str:
    """Whether runners sample while the learner updates; a dash where there are none."""
    if not one["runners"]:
        return "-"
    return "yes" if one["overlap"] else "no"


def fraction(value: float) -> str:
    """As 1/16."""
    return str(Fraction(value).limit_denominator(10_000))


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
            one["settings"], f"{one['runners']:,}", *speeds(one), *(f"{one['shares'][name]:.0%}" for name in names),
            hidden(one), f"{one['most_samples_per_second']:,.0f}", f"{one['enough_runners']:,}",
        ]
        for one in found["far"]
    ]  # fmt: skip
    return markdown(
        ["settings", "runners", "samples/s", "updates/s", *names, "hidden", "at most", "90 % of it with"], rows
    )


def moves(found: Found) -> str:
    """What moves each part."""
    return markdown(["waits most for", "what moves it"], [list(pair) for pair in MOVES.items()])


def curves(found: Found) -> tuple[dict[str, Here], dict[str, Points]]:
    """What `draw_scaling` draws: by updates a step the measured and the modelled, and by settings the modelled.

    Each point is (runners, samples a second).
    """
    here: dict[str, Here] = {}
    for one in found["rounds"]:
        if one["learners"]:
            continue
        overlapping, waiting, model = here.setdefault(
            f"{fraction(one['updates_per_step'])} updates a step", Here([], [], [])
        )
        (overlapping if one["overlap"] else waiting).append((one["runners"], one["samples_per_second"]))
        if one["overlap"]:
            model.append((one["runners"], one["model"]["samples_per_second"]))
    return here, {one["settings"]: _along(found, one["changes"]) for one in found["far"]}


def _along(found: Found, changes: Mapping[str, Any]) -> Points:
    """Samples a second along ``RANGE``, with other settings and a core for every process."""
    costs, settings = Costs(**found["costs"]), {**found["setup"], **changes, "cores": None}
    return [(float(n), round_of(costs, Setup(runners=n, **settings)).samples_per_second) for n in RANGE]
