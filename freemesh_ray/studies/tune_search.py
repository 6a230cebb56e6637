"""A search as Ray Tune's own parts: the space, the searcher and the scheduler."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ray import tune
from ray.tune.schedulers import AsyncHyperBandScheduler, FIFOScheduler, PopulationBasedTraining, TrialScheduler
from ray.tune.search import BasicVariantGenerator, SearchAlgorithm, Searcher

from freemesh_ray.studies.definition import Search, Study
from freemesh_ray.studies.plan import default_point, point
from freemesh_ray.studies.space import Space

TIME_ATTR = "env_steps"
#: A perturbation of population based training multiplies a number by one of these.
FACTORS = (0.8, 1.25)


def param_space(search: Search) -> dict[str, Any]:
    """What Tune draws each trial's settings from."""
    return {key: distribution(space) for key, space in search.space.items()}


def distribution(space: Space) -> Any:
    """One setting's distribution as Tune has it."""
    match space.distribution:
        case "uniform":
            return tune.uniform(*space.values)
        case "log":
            return tune.loguniform(*space.values)
        case "choice":
            return tune.choice(list(space.values))


#: A draw and its figure at its end.
Draw = tuple[dict[str, Any], float]


def searcher(study: Study, known: Sequence[Draw] = ()) -> Searcher | SearchAlgorithm:
    """What proposes points: the study's own settings first, then by what was found.

    Args:
        study: the search.
        known: draws that are over, where more are added: they are told to the searcher, and not drawn again.
    """
    search = study.search
    assert search is not None
    first = [] if known else [default_point(study)]
    if search.searcher == "random" or search.scheduler == "pbt":
        return BasicVariantGenerator(points_to_evaluate=first or None, random_state=study.seeds[0] + len(known))
    import optuna
    from ray.tune.search.optuna import OptunaSearch

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    told = [(drawn, figure) for drawn, figure in known if math.isfinite(figure)]
    return OptunaSearch(
        points_to_evaluate=[drawn for drawn, _ in told] or first,
        evaluated_rewards=[figure for _, figure in told] or None,
        metric=study.metric,
        mode="max",
        seed=study.seeds[0] + len(known),
    )


def as_drawn(study: Study, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings of a draw, read from a file, as Tune drew them: lists are tuples."""
    assert study.search is not None
    return point({key: settings[key] for key in study.search.space})


def scheduler(study: Study | None, budget: int) -> TrialScheduler:
    """What stops or changes trials on their way; of no search nothing does."""
    search = study.search if study else None
    if study is None or search is None or search.scheduler == "none":
        return FIFOScheduler()
    if search.scheduler == "asha":
        grace = min(search.grace, budget)
        return AsyncHyperBandScheduler(
            time_attr=TIME_ATTR, metric=study.metric, mode="max", max_t=budget + 1, grace_period=grace,
            reduction_factor=search.reduction,
        )  # fmt: skip
    return PopulationBasedTraining(
        time_attr=TIME_ATTR,
        metric=study.metric,
        mode="max",
        perturbation_interval=search.perturbation,
        hyperparam_mutations=mutations(search.space),
        perturbation_factors=FACTORS,
        custom_explore_fn=_within(search.space),
        synch=False,
    )


def mutations(spaces: Mapping[str, Space]) -> dict[str, Any]:
    """What population based training draws a setting from when it does not perturb it."""
    return {
        key: list(space.values) if space.distribution == "choice" else distribution(space)
        for key, space in spaces.items()
    }


def _within(spaces: Mapping[str, Space]) -> Any:
    """A function that brings a perturbed setting that left its space back to the end that it lies beyond."""

    def explore(config: dict[str, Any]) -> dict[str, Any]:
        for key, space in spaces.items():
            if space.distribution != "choice":
                config[key] = space.nearest(config[key])
        return config

    return explore
