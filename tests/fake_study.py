"""A study of an algorithm that learns nothing, fast: ``python fake_study.py STUDY.yaml [--resume] [RECORDS ...]``.

Every beginning, every restored checkpoint and every failure is a line in the file that FAKE_LOG names. With
FAKE_COMPLETION evaluations say that so great a share of the meshes was completed.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from curricula import curriculum

from envs.domains.load import load
from envs.types import MeshingParameters
from freemesh_ray.policies.evaluation import evaluate
from freemesh_ray.policies.policy import Policy


def say(*words: object) -> None:
    with open(os.environ["FAKE_LOG"], "a") as file:
        file.write(" ".join(map(str, words)) + "\n")


class Fake:
    """100 steps an iteration; with batch size 13 it raises at step 400."""

    def __init__(self, config: Mapping[str, Any]) -> None:
        self.config = config
        self.env_steps = self.updates = 0
        self.curriculum = curriculum("T1")
        self.finished: list[Any] = []
        self.incidents: list[str] = []
        say("begin", self.name)

    @property
    def name(self) -> str:
        return f"{self.config['learner']['batch_size']}/{self.config['seed']}"

    def train(self) -> dict[str, Any]:
        time.sleep(float(os.environ.get("FAKE_PAUSE", "0")))
        self.env_steps += 100
        self.updates += 50
        if self.config["learner"]["batch_size"] == 13 and self.env_steps >= 400:
            say("fail", self.name)
            raise RuntimeError("batches of thirteen bring bad luck")
        return {}

    def actor_weights(self) -> list[tuple[Any, Any]]:
        bias = np.array([0, 0, 0, 0.3, 0.3, 0.3], dtype=np.float32)
        return [(np.zeros((15, 6), dtype=np.float32), bias)]

    def critic_weights(self) -> list[tuple[Any, Any]]:
        return []

    def evaluate(self) -> dict[str, Any]:
        policy = Policy(self.actor_weights(), MeshingParameters())
        figures = evaluate(policy, load("T1"), 2, self.config["seed"] + self.env_steps)
        told = os.environ.get("FAKE_COMPLETION")
        known = {"completion_rate": float(told)} if told else {}
        return {mode: {"T1": {**of_mode, **known}} for mode, of_mode in figures.items()}

    def get_state(self) -> dict[str, Any]:
        return {"env_steps": self.env_steps, "updates": self.updates}

    def set_state(self, state: dict[str, Any]) -> None:
        self.env_steps, self.updates = state["env_steps"], state["updates"]
        say("restore", self.name, self.env_steps)

    def stop(self) -> None:
        pass


def main(file: str, *options: str) -> None:
    from freemesh_ray.local_ray import local_ray
    from freemesh_ray.studies import uptake
    from freemesh_ray.studies.definition import load as load_study
    from freemesh_ray.studies.runner import run

    places = [option for option in options if option != "--resume"]
    recorded = uptake.read(places) if places else None
    with local_ray(1):
        run(load_study(file), resume="--resume" in options, make=Fake, recorded=recorded, note=print)


if __name__ == "__main__":
    import fake_study  # the class must have a name that other processes can import

    fake_study.main(*sys.argv[1:])
