"""A learner in one thread, whose learning rates are the configuration's whatever a checkpoint holds."""

from __future__ import annotations

import copy
from typing import Any

import torch
from ray.rllib.core.learner.torch.torch_learner import TorchLearner
from ray.rllib.utils.metrics import WEIGHTS_SEQ_NO


class ConfiguredLearner(TorchLearner):
    """RLlib's learner; one thread, so that processes do not fight for cores."""

    def build(self) -> None:
        """Build module and optimizers."""
        torch.set_num_threads(1)
        super().build()

    def set_state(self, state: dict[str, Any]) -> None:
        """Take over a state, also an older one: RLlib would ignore weights whose number is not above the learner's."""
        number = max(state.get(WEIGHTS_SEQ_NO, 0), self._weights_seq_no + 1)
        super().set_state({**state, WEIGHTS_SEQ_NO: number})

    def _set_optimizer_state(self, state: Any) -> None:
        # An optimizer works in the arrays that it is given; those of a message lie in memory that all learners share.
        super()._set_optimizer_state(copy.deepcopy(state))
        # The state holds the learning rate, too: a resumed training would not learn at the rate it is given.
        for optimizer, schedule in self._optimizer_lr_schedules.items():
            self._set_optimizer_lr(optimizer, schedule.get_current_value())
