"""What a records file holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from envs.errors import UserError
from freemesh_ray.records.measured import Measured


class RecordsError(UserError, ValueError):
    """A records file that cannot be used; one line with its name, what is wrong and the fix."""


@dataclass(frozen=True)
class Training:
    """One training of a study.

    Attributes:
        label, seed: which.
        run: ID and steps, the name of its run folder.
        status: as ``trials.json`` has it; ``error``: of a failed one, in a line.
        drawn: setting -> value that a search gave it.
        settings: dotted key -> value of its configuration, without those that say where things lie.
        evaluations: one entry an evaluation: ``env_steps``, ``seconds`` and figures by metric.
        updates: gradient updates at its end; None where that is not known.
        measured: of its best policy; None where it left none.
    """

    label: str
    seed: int
    run: str
    status: str
    error: str = ""
    drawn: Mapping[str, Any] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    evaluations: Sequence[Mapping[str, Any]] = ()
    updates: int | None = None
    measured: Measured | None = None


@dataclass(frozen=True)
class StudyRecords:
    """A study and what came of it.

    Attributes:
        name: of the study.
        study: its study.yaml, without settings that say where things lie.
        trainings: in the study's order.
        episodes: of each policy on each domain of the report, of each mode.
        domains: name -> digest of those of the report's domains that could be loaded.
        skipped: what the report left out -> why.
        paper_table: measured with the policies, in Markdown; empty without.
        source: package -> digest of the code, or version, that trained (`freemesh_ray.studies.training_source`).
        version: of freemesh-ray that recorded.
        machine: that recorded.
        date: of the newest evaluation, as 2026-01-31; empty without.
    """

    name: str
    study: str
    trainings: Sequence[Training]
    episodes: int
    domains: Mapping[str, str] = field(default_factory=dict)
    skipped: Mapping[str, str] = field(default_factory=dict)
    paper_table: str = ""
    source: Mapping[str, str] = field(default_factory=dict)
    version: str = ""
    machine: str = ""
    date: str = ""
