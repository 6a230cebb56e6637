"""Results of several studies and runs as those of one, so that one report compares them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from freemesh_ray.formatting.markdown import escaped
from freemesh_ray.report.number_text import count
from freemesh_ray.report.results import Results, TrialResult
from freemesh_ray.studies.definition import Study
from freemesh_ray.studies.study_folder import StudyError

#: Names of run folders that say what was trained: its ID and its steps.
IDENTITY = re.compile(r"trial-[0-9a-f]{12}-\d+")


def together(given: Sequence[tuple[str, Results]]) -> Results:
    """The results of one study whose variants are those of all, ``study: variant``.

    Variants of two studies that have a training in common, by its ID and steps, are one: it is shown once.

    Args:
        given: what the user calls each, and its results; two at least.

    Raises:
        StudyError: they cannot be compared.
    """
    names = _names([results for _, results in given])
    _check(given)
    labels: dict[str, dict[tuple[str, str | int], TrialResult]] = {}
    others: dict[str, list[str]] = {}
    variants = {}
    for name, (_, results) in zip(names, given, strict=True):
        for label in results.labels:
            trials = {_identity(name, trial): trial for trial in results.of(label)}
            own = name if results.single else f"{name}: {label}"
            same = next((known for known, there in labels.items() if there.keys() & trials.keys()), None)
            if same is None:
                labels[own], variants[own] = trials, results.study.variants.get(label, [])
                continue
            others.setdefault(same, []).append(own)
            for key, trial in trials.items():
                before = labels[same].get(key)
                if before is None or (trial.finished and not before.finished):
                    labels[same][key] = trial
    shown = [replace(trial, label=label) for label, found in labels.items() for trial in found.values()]
    studies = [results.study for _, results in given]
    study = Study(
        name="+".join(names), title=", ".join(names), settings=[], variants=variants,
        seeds=sorted({trial.seed for trial in shown}), metric=_metric(given), domains=_domains(given),
    )  # fmt: skip
    lines = [
        f"- {escaped(name)}: {_told(of, results)}" for name, of, (_, results) in zip(names, studies, given, strict=True)
    ]
    lines += [
        f"- {escaped(' and '.join([label, *more]))}: the same training, shown once" for label, more in others.items()
    ]
    return Results(study, shown, preface="Compared here:\n\n" + "\n".join(lines))


def _told(study: Study, results: Results) -> str:
    if results.single:
        return "a training"
    return f"{escaped(study.title)}, {count(len(results.labels), 'variant')}, {count(len(results.trials), 'trial')}"


def _names(given: Sequence[Results]) -> list[str]:
    """The studies' names; of several of one name all but the first have a number."""
    found: list[str] = []
    for results in given:
        name, number = results.study.name, 1
        while name in found:
            number += 1
            name = f"{results.study.name} ({number})"
        found.append(name)
    return found


def _check(given: Sequence[tuple[str, Results]]) -> None:
    """Refuse what cannot be compared.

    Raises:
        StudyError: as said.
    """
    for called, results in given:
        if results.study.search:
            raise StudyError(
                f"{called}: is a search, whose draws are ranked in its own report: compare studies of variants"
            )
    metrics = {results.study.metric: called for called, results in given if not results.single}
    if len(metrics) > 1:
        (one, first), (other, second), *_ = metrics.items()
        raise StudyError(
            f"{first} and {second}: are judged by different metrics ({one}, {other}): compare studies of one metric"
        )


def _metric(given: Sequence[tuple[str, Results]]) -> str:
    of_studies = [results.study.metric for _, results in given if not results.single]
    return of_studies[0] if of_studies else given[0][1].study.metric


def _domains(given: Sequence[tuple[str, Results]]) -> list[str]:
    """The domains that all studies have."""
    of_studies = [results.study.domains for _, results in given if not results.single]
    return [domain for domain in of_studies[0] if all(domain in each for each in of_studies)] if of_studies else []


def _identity(name: str, trial: TrialResult) -> tuple[str, str | int]:
    """What a training is known by: ID and steps, or else its place in its study."""
    if IDENTITY.fullmatch(trial.run):
        return trial.run, 0
    return f"{name}: {trial.label}", trial.seed
