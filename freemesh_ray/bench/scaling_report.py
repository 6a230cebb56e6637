"""What the measurement of scaling found, in words, tables and curves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from freemesh_ray.bench.cost import MOVES, Costs, Setup, round_of
from freemesh_ray.table import markdown

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


def text(found: Found) -> str:
    """The report, in Markdown."""
    setup, machine, goal = found["setup"], found["machine"], found["return"]
    return "\n".join(
        [
            "# Scaling, as measured",
            "",
            f"{machine['cores']} cores, {machine['system']}; SAC on T1, {setup['envs']} environments a runner, "
            f"fragments of {setup['fragment']} steps, {setup['updates_per_step']:g} updates a step, batch "
            f"{setup['batch']}; {found['seconds']:g} s a measurement. What the numbers mean stands in docs/scaling.md.",
            "",
            "## Whole training rounds",
            "",
            rounds(found),
            "",
            f"## Time to a return of {goal['wanted']:g}",
            "",
            f"The mean return of the last {goal['episodes']} training episodes, from the first round on; one seed "
            f"({goal['seed']}), so that a difference between two lines may be luck.",
            "",
            returns(found),
            "",
            "## The parts of a round, each measured alone",
            "",
            parts(found),
            "",
            "## Beyond this machine: the model, every process on a core of its own",
            "",
            far(found),
            "",
            *verdicts(found),
            "",
        ]
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
            f"{one['most_samples_per_second']:,.0f}", f"{one['enough_runners']:,.0f}",
        ]
        for one in found["far"]
    ]  # fmt: skip
    return markdown(["settings", "runners", "samples/s", "updates/s", *names, "at most", "90 % of it with"], rows)


def verdicts(found: Found) -> list[str]:
    """A sentence for each number of runners: the bottleneck, and what moves it."""
    first = [one for one in found["far"] if one["settings"] == found["far"][0]["settings"]]
    return [
        f"With {one['runners']:,} runners {one['bottleneck']} takes {one['shares'][one['bottleneck']]:.0%} of a round. "
        f"What moves it: {MOVES[one['bottleneck']]}."
        for one in first
    ] + [
        f"More than {first[0]['enough_runners']:,.0f} runners give less than a tenth more: with these settings no "
        f"number of them passes {first[0]['most_samples_per_second']:,.0f} samples a second."
    ]


Points = list[tuple[float, float]]


def curves(found: Found) -> tuple[dict[str, tuple[Points, Points]], dict[str, Points]]:
    """What `plots.draw_scaling` draws: by learners the measured and the modelled, and by settings the modelled.

    Each point is (runners, samples a second).
    """
    here: dict[str, tuple[Points, Points]] = {}
    for one in found["rounds"]:
        label = f"{one['learners']} learners" if one["learners"] else "learner in the training's process"
        measured, modelled = here.setdefault(label, ([], []))
        measured.append((one["runners"], one["samples_per_second"]))
        modelled.append((one["runners"], one["modelled_samples_per_second"]))
    return here, {one["settings"]: _modelled(found, one["changes"]) for one in found["far"]}


def _modelled(found: Found, changes: Mapping[str, Any]) -> Points:
    """Samples a second along ``RANGE``, with other settings and a core for every process."""
    costs, settings = Costs(**found["costs"]), {**found["setup"], **changes, "cores": None}
    return [(float(n), round_of(costs, Setup(runners=n, **settings)).samples_per_second) for n in RANGE]
