"""k gradient steps on k minibatches in one call.

A step descends along the losses of an algorithm as its paper prints them, by automatic differentiation. SAC and TD3
have the same step with its gradients written out, which is faster; tests hold the two equal. With ``precision``
bfloat16 the networks' products multiply bfloat16 numbers: in the written-out steps as `Bfloat16Mlp` does it, else as
torch's autocast does.

Several learners do what one would do with the whole minibatches: each has its share of the rows of every one, and
descends along the mean of all learners' gradients.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import torch
from ray.rllib.algorithms.algorithm_config import AlgorithmConfig
from ray.rllib.core.columns import Columns

from freemesh_ray.algorithms import block_products
from freemesh_ray.algorithms.adam import LeanAdam
from freemesh_ray.algorithms.alignment import aligned
from freemesh_ray.algorithms.averaging import averaged, broadcast_from_first
from freemesh_ray.algorithms.bfloat16 import Bfloat16Mlp, wanted
from freemesh_ray.algorithms.compiled_mlp import CompiledMlp
from freemesh_ray.algorithms.configured_learner import ConfiguredLearner
from freemesh_ray.algorithms.networks import Mlp, on_cpu
from freemesh_ray.algorithms.onednn import OneDnnMlp
from freemesh_ray.algorithms.onednn import available as onednn_available

#: A network as a written-out step evaluates it.
Evaluated = Mlp | OneDnnMlp | Bfloat16Mlp | CompiledMlp
#: What tells each figure of a step.
Figures = dict[str, Callable[[], torch.Tensor]]
#: Column of a batch: ``Transitions.steps``.
STEPS = "steps"


class Minibatch(NamedTuple):
    """What one gradient step learns from, on the learner's device.

    Attributes:
        obs, actions, rewards, next_obs: as in ``Transitions``, observations as the networks see them.
        discounts: (rows,) what the value of next_obs counts: gamma for each step to it, 0 where it is terminal.
        noise: (draws, rows, action size) standard normal.
    """

    obs: torch.Tensor
    actions: torch.Tensor
    rewards: torch.Tensor
    next_obs: torch.Tensor
    discounts: torch.Tensor
    noise: torch.Tensor


class OffPolicyLearner(ConfiguredLearner):
    """Updates an ActorCriticModule from batches of k x ``train_batch_size_per_learner`` transitions.

    A subclass gives the losses (``losses``); where it optimises more than critics and actor, what (``optimised``); and
    where it needs another amount of noise, how much (``draws``). It may write the step out by hand (``_step``).
    """

    #: Of Adam.
    BETAS = (0.9, 0.999)
    #: Whether the targets follow only in a step in which the actor was updated.
    TARGETS_WAIT = False
    #: Gradient steps taken, the present one included.
    _steps = 0

    @abstractmethod
    def losses(self, module: Any, config: Any, minibatch: Minibatch) -> Iterator[tuple[str, torch.Tensor]]:
        """One step as a textbook prints it: an optimizer's name and the scalar loss that it descends along, in order.

        Each optimizer has made its step before the next loss is asked for. After the last one the targets follow; with
        ``TARGETS_WAIT`` if there was a loss of the actor.

        Args:
            module: what is updated.
            config: its settings.
            minibatch: what from.
        """

    def optimised(self, module: Any, config: Any) -> dict[str, tuple[list[torch.Tensor], float]]:
        """Parameters and learning rate of each optimizer, by its name."""
        return {
            "critic": (list(module.critic.parameters()), config.critic_lr),
            "actor": (list(module.actor.parameters()), config.actor_lr),
        }

    def draws(self, config: Any) -> int:
        """Standard normal numbers that a step needs for each component of each row's action.

        Two: for the action at each state and at its successor.
        """
        return 2

    def _step(self, module_id: str, config: Any, minibatch: Minibatch) -> Figures:
        """One gradient step on one minibatch; what tells its figures by name, losses ending in ``_loss``.

        Nothing is read from the learner's device, which would wait for what is queued on it. Figures are worked out
        when they are asked for: only the last minibatch's are.
        """
        module = self._module[module_id]
        optimised = self.optimised(module, config)
        figures: Figures = {}
        rounded = torch.autocast(self._device.type, torch.bfloat16, self._rounds, cache_enabled=False)
        with torch.enable_grad(), rounded:
            for name, loss in self.losses(module, config, minibatch):
                self._descend(module_id, name, torch.autograd.grad(loss, optimised[name][0]))
                figures[f"{name}_loss"] = loss.detach
        if "actor_loss" in figures or not self.TARGETS_WAIT:
            self._follow(module_id, config)
        return figures

    def _follow(self, module_id: str, config: Any) -> None:
        """Let the targets follow their networks."""
        module = self._module[module_id]
        for name in module.TARGETED:
            torch._foreach_lerp_(*self._following(module_id, name), config.tau)
            self._networks(module_id)[f"target_{name}"].refresh()

    def _following(self, module_id: str, name: str) -> tuple[list[torch.Tensor], list[torch.Tensor]]:
        """The parameters of a network's target and its own; they stay the same tensors."""
        if (module_id, name) not in self._followed:
            networks = (getattr(self._module[module_id], which) for which in (f"target_{name}", name))
            target, own = (list(network.parameters()) for network in networks)
            self._followed[module_id, name] = target, own
        return self._followed[module_id, name]

    def _networks(self, module_id: str) -> dict[str, Evaluated]:
        """The module's networks by name, as a written-out step evaluates them."""
        if module_id not in self._evaluated:
            networks = {name: part for name, part in self._module[module_id].named_children() if isinstance(part, Mlp)}
            self._evaluated[module_id] = {name: self._as_evaluated(network) for name, network in networks.items()}
        return self._evaluated[module_id]

    def _as_evaluated(self, network: Mlp) -> Evaluated:
        here = on_cpu(network.weights[0])
        if self._rounds:
            processor = block_products.processor() if here else None
            return Bfloat16Mlp(network) if processor is None else CompiledMlp(network, processor)
        return OneDnnMlp(network) if here and onednn_available() else network

    def configure_optimizers_for_module(self, module_id: str, config: AlgorithmConfig | None = None) -> None:
        """One fused Adam for each of ``optimised``."""
        for name, (parameters, rate) in self.optimised(self._module[module_id], config or self.config).items():
            self.register_optimizer(
                module_id=module_id,
                optimizer_name=name,
                optimizer=LeanAdam(parameters, lr=rate, betas=self.BETAS),
                params=parameters,
                lr_or_lr_schedule=rate,
            )

    def build(self) -> None:
        """Build module, optimizers and the source of the steps' noise."""
        self._evaluated: dict[str, dict[str, Evaluated]] = {}
        self._followed: dict[tuple[str, str], tuple[list[torch.Tensor], list[torch.Tensor]]] = {}
        super().build()
        #: Whether products are of bfloat16 numbers.
        self._rounds = wanted(self.config.precision, self._device)
        # Every learner draws the noise of the whole minibatch and takes that of its rows. On the CPU whatever the
        # learner's device: so a state can be taken over by a learner of another device, and by another number of them.
        self._noise = torch.Generator().manual_seed(self.config.seed or 0)
        #: Every figure as it was last told: of one that is told once, RLlib tells a nan where there is no new one.
        self._told: dict[str, float] = {}

    def _make_modules_ddp_if_necessary(self) -> None:
        # Not RLlib's wrapper, which averages the gradients of automatic differentiation: see _descend.
        if self.distributed:
            broadcast_from_first(tensor for module in self._module.values() for tensor in module.state_dict().values())

    def compute_loss_for_module(self, **kwargs: Any) -> Any:
        """Not how this learner works: ``_update`` takes each loss's gradient on its own."""
        raise TypeError(f"{type(self).__name__} updates in _update; it has no single loss")

    def get_state(self, *args: Any, **kwargs: Any) -> dict[str, Any]:
        """The learner's state with the random state of its noise, its count of steps and the figures last told."""
        own = {"noise": self._noise.get_state().numpy(), "steps": self._steps, "told": dict(self._told)}
        return super().get_state(*args, **kwargs) | own

    def set_state(self, state: dict[str, Any]) -> None:
        """Take over a state."""
        super().set_state(state)
        if "noise" in state:
            self._noise.set_state(torch.from_numpy(state["noise"]))
        self._steps = state.get("steps", self._steps)
        self._told = dict(state.get("told", self._told))

    @torch.no_grad()
    def _update(self, batch: dict[str, Any], **kwargs: Any) -> tuple[Any, dict[str, Any], Any]:
        losses: dict[str, Any] = {}
        for module_id, rows in batch.items():
            config = self.config.get_config_for_module(module_id)
            for network in self._networks(module_id).values():
                network.refresh()  # the weights may have been set since
            size = config.train_batch_size_per_learner
            names = (Columns.OBS, Columns.ACTIONS, Columns.REWARDS, Columns.NEXT_OBS)
            rows = self._seen(module_id, rows)
            discounts = config.gamma ** rows[STEPS] * (1.0 - rows[Columns.TERMINATEDS])
            obs, actions, rewards, next_obs = (aligned(rows[name]) for name in names)
            noise = self._drawn(len(obs) // size, (self.draws(config), size, actions.shape[1]))
            whole = Minibatch(obs, actions, rewards, next_obs, aligned(discounts), noise)
            figures = self._descend_all(module_id, config, whole, size)
            means = [figure().mean() for figure in figures.values()]
            norms = torch.stack(torch._foreach_norm(list(self._module[module_id].parameters()))).sum()
            *told, norms = torch.stack([*means, norms.to(means[0].dtype)]).tolist()
            values = self._told = self._told | dict(zip(figures, told, strict=True))
            if not math.isfinite(norms):  # what is no number, a ReLU makes 0 of, and the losses stay numbers
                values = {name: math.nan if name.endswith("_loss") else value for name, value in values.items()}
            self.metrics.log_dict(values, key=module_id, window=1)
            losses[module_id] = torch.tensor(sum(values[name] for name in values if name.endswith("_loss")))
        return {}, losses, {}

    def _descend_all(self, module_id: str, config: Any, rows: Minibatch, size: int) -> Figures:
        """A step on each of several minibatches; what tells the figures, as of ``_step``.

        Args:
            module_id: what is updated.
            config: its settings.
            rows: all of them, one after another; the noise has an axis in front.
            size: rows of one.
        """
        # With layer normalisation by automatic differentiation: no step is written out for it.
        step = partial(OffPolicyLearner._step, self) if config.layer_norm else self._step
        figures: Figures = {}
        columns = (column.split(size) for column in rows[:-1])
        for minibatch in map(Minibatch, *columns, rows.noise):
            self._steps += 1
            figures |= step(module_id, config, minibatch)
        return figures

    def _seen(self, module_id: str, rows: Any) -> dict[str, torch.Tensor]:
        """The columns with observations as the networks see them, after the normaliser has seen these."""
        module = self._module[module_id]
        columns = dict(rows)
        if module.normaliser is not None:
            module.normaliser.take(columns[Columns.OBS], distributed=self.distributed)
            columns |= {key: module.seen(columns[key]) for key in (Columns.OBS, Columns.NEXT_OBS)}
        return columns

    def _drawn(self, count: int, shape: tuple[int, int, int]) -> torch.Tensor:
        """Standard normal noise for ``count`` minibatches, of which this learner has ``shape``, on its device."""
        draws, rows, width = shape
        learners = max(1, self.config.num_learners)
        first = rows * self._learner_index if self.distributed else 0
        whole = (torch.randn((draws, rows * learners, width), generator=self._noise) for _ in range(count))
        return torch.stack([noise[:, first : first + rows] for noise in whole]).to(self._device)

    def _descend(self, module_id: str, name: str, gradients: list[torch.Tensor] | tuple[torch.Tensor, ...]) -> None:
        if self.distributed:
            gradients = averaged(gradients)
        self._named_optimizers[f"{module_id}_{name}"].descend(gradients)
        if name in (networks := self._networks(module_id)):
            networks[name].refresh()
