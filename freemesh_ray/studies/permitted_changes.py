"""What of a study that was begun may change: it grows, and what has been trained stays of use."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from freemesh_ray import config
from freemesh_ray.config import ConfigError, flatten
from freemesh_ray.studies.definition import SEARCH_KEYS, Search, Study, load
from freemesh_ray.studies.plan import LENGTH

#: Keys of a study that decide nothing of what is trained, and those of lists that may become longer.
FREE = ("title", "paper", "finding", "retries")
LISTS = ("seeds", "domains", "expects")


def refused(before: Study, now: Study) -> list[str]:
    """What differs and cannot: keys, each with the reason; empty where ``now`` extends ``before``."""
    return list(dict.fromkeys([*_of_lists(before, now), *_of_search(before, now), *_of_trials(before, now)]))


def _of_lists(before: Study, now: Study) -> Iterator[str]:
    old, new = before.tree()["study"], now.tree()["study"]
    for key in LISTS:
        gone = [str(value) for value in old.get(key, []) if value not in new.get(key, [])]
        if gone:
            yield f"study.{key} (without {', '.join(gone)})"
    for label in before.variants:
        now_has = now.seeds_of(label) if label in now.variants else ()
        gone = [str(seed) for seed in before.more_seeds.get(label, ()) if now_has and seed not in now_has]
        if gone:
            yield f"study.more_seeds.{label} (without {', '.join(gone)})"
    if before.metric != now.metric:
        yield f"study.metric ({now.metric}, was {before.metric})"
    gone = [label for label in before.variants if label not in now.variants]
    if gone:
        yield f"study.variants (without {', '.join(gone)})"


def _of_search(before: Study, now: Study) -> Iterator[str]:
    old, new = before.search, now.search
    if old is None or new is None:
        if old is not new:
            yield "study.search (a study is of variants or a search)"
        return
    if list(before.seeds) != list(now.seeds):
        yield "study.seeds (a search's draws are scored over the same)"
    if old.space != new.space:
        yield "study.search.space"
    if new.trials < old.trials or (old.scheduler == "pbt" and new.trials != old.trials):
        yield f"study.search.trials ({new.trials}, was {old.trials})"
    for key in SEARCH_KEYS:
        if key != "trials" and getattr(old, key) != getattr(new, key):
            yield f"study.search.{key} ({getattr(new, key)}, was {getattr(old, key)})"
    if _confirmed_less(old, new):
        yield "study.search.confirm (more of best and seeds can be given, not less)"


def _confirmed_less(old: Search, new: Search) -> bool:
    if old.confirm is None:
        return False
    if new.confirm is None or new.confirm.best < old.confirm.best:
        return True
    return not {*old.confirm.seeds} <= {*new.confirm.seeds}


def _of_trials(before: Study, now: Study) -> Iterator[str]:
    """Settings of the trials that both have, and where their files go."""
    written = [study.tree()["settings"] for study in (before, now)]
    for key in dict.fromkeys([*written[0], *written[1]]):
        if key.startswith(("paths.", "tracking.")) and written[0].get(key) != written[1].get(key):
            yield f"settings.{key}"
    both: list[str | None] = [label for label in before.variants if label in now.variants]
    for label in both or [None]:
        if label is not None and [*before.seeds_of(label)] != [*now.seeds_of(label)] and not now.seeds:
            yield f"study.variants.{label}.seed"
            continue
        trees = [_tree(study, label) for study in (before, now)]
        (old, new), (less, more) = map(flatten, trees), (tree["budget"]["env_steps"] for tree in trees)
        for key in dict.fromkeys([*old, *new]):
            if key.startswith(("name", "paths.", "tracking.", "checkpoint.")) or old.get(key) == new.get(key):
                continue
            longer = key == LENGTH and less < more
            if longer and before.search is None:
                continue
            own = label is not None and key in {entry.key for entry in now.variants[label]}
            why = f" ({new.get(key)}, was {old.get(key)}{': draws are compared at one length' if longer else ''})"
            yield f"{f'study.variants.{label}' if own else 'settings'}.{key}{why}"


def _tree(study: Study, label: str | None) -> dict[str, Any]:
    return study.settings_of_all() if label is None else study.trial_config(label, study.seeds_of(label)[0])


def extended(study: Study, additions: Sequence[str]) -> Study:
    """The study with what ``--add KEY=VALUE`` adds, as written down in its folder.

    Args:
        study: as it was begun.
        additions: of seeds, domains or expects more values, of more_seeds a variant's, of variants more labels with
            their settings, of trials and env_steps how many more.

    Raises:
        ConfigError: an addition that cannot be used.
    """
    tree = study.tree()
    for text in additions:
        key, equals, value = (part.strip() for part in text.partition("="))
        if not equals or key not in ADDITIONS:
            raise ConfigError(f"--add {text}: write KEY=VALUE, of {', '.join(ADDITIONS)}")
        ADDITIONS[key](tree, study, value, f"--add {text}")
    more = tree["study"].get("more_seeds", {})
    tree["study"]["more_seeds"] = {label: seeds for label, seeds in more.items() if seeds}
    return replace(load(tree), name=study.name, paths=study.paths)


def _add_values(key: str) -> Callable[[dict[str, Any], Study, str, str], None]:
    def add(tree: dict[str, Any], study: Study, value: str, place: str) -> None:
        values = [value] if key == "expects" else _read(value if value.startswith("[") else f"[{value}]", place)
        known = tree["study"].setdefault(key, [])
        known += [each for each in values if each not in known]
        if key == "seeds":  # what some had before, all have now
            for own in tree["study"].get("more_seeds", {}).values():
                own[:] = [seed for seed in own if seed not in known]

    return add


def _add_more_seeds(tree: dict[str, Any], study: Study, value: str, place: str) -> None:
    more = _read(value, place)
    if not isinstance(more, Mapping) or not all(isinstance(seeds, list) for seeds in more.values()):
        raise ConfigError(f"{place}: write {{LABEL: [4, 5]}}")
    known = tree["study"].setdefault("more_seeds", {})
    for label, seeds in more.items():
        had = known.setdefault(label, [])
        had += [seed for seed in seeds if seed not in had]


def _add_variants(tree: dict[str, Any], study: Study, value: str, place: str) -> None:
    variants = _read(value, place)
    if study.search or not isinstance(variants, Mapping):
        raise ConfigError(f"{place}: write {{LABEL: {{learner.gamma: 0.9}}}}, for a study of variants")
    if known := [label for label in variants if label in tree["study"]["variants"]]:
        raise ConfigError(f"{place}: {known[0]} is there already: give another label")
    tree["study"]["variants"] |= variants


def _add_trials(tree: dict[str, Any], study: Study, value: str, place: str) -> None:
    if study.search is None:
        raise ConfigError(f"{place}: a study of variants has no trials to add: add seeds or variants")
    tree["study"]["search"]["trials"] += _number(value, place)


def _add_steps(tree: dict[str, Any], study: Study, value: str, place: str) -> None:
    tree["settings"][LENGTH] = study.settings_of_all()["budget"]["env_steps"] + _number(value, place)


#: What ``--add`` takes.
ADDITIONS: Mapping[str, Callable[[dict[str, Any], Study, str, str], None]] = {
    "seeds": _add_values("seeds"),
    "more_seeds": _add_more_seeds,
    "domains": _add_values("domains"),
    "expects": _add_values("expects"),
    "variants": _add_variants,
    "trials": _add_trials,
    "env_steps": _add_steps,
}


def _number(value: str, place: str) -> int:
    number = _read(value, place)
    if isinstance(number, bool) or not isinstance(number, int | float) or number < 1 or number != int(number):
        raise ConfigError(f"{place}: give a whole number, how many more")
    return int(number)


def _read(value: str, place: str) -> Any:
    node = config.composed(value, place)
    return None if node is None else config.plain(node, place)
