"""A trained policy on its own: the actor's weights and what they expect, in one file that needs neither Ray nor torch.

The file is a NumPy archive: ``weight_0``, ``bias_0``, .., for a policy with critics ``critic_weight_0``,
``critic_bias_0``, .., and ``about``, a JSON text with the MDP's parameters and whatever is worth knowing of the
training.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from envs.errors import UserError
from envs.plug_ins.environment_parts import NONE, PlugIns
from envs.plug_ins.lookup import is_spec
from envs.types import MeshingParameters
from freemesh_ray.storage.array_archive import read_arrays
from freemesh_ray.storage.atomic import replacing

#: The policies that ship with the package, by how large they cut the elements; their card lies beside them.
#: ``even`` keeps to the edge length of the boundary, graded inwards.
SHIPPED = {name: Path(__file__).parent / f"{name}.npz" for name in ("sparse", "medium", "dense", "even")}
DENSITY = "even"
DEFAULT = SHIPPED[DENSITY]
#: What stands for the paper's policy in its tables: of its MDP.
OF_THE_PAPER = SHIPPED["medium"]

Layer = tuple[np.ndarray, np.ndarray]
#: What reading a file raises that is no policy.
UNREADABLE = (OSError, ValueError, LookupError, TypeError, AttributeError, OverflowError, RecursionError)

LOG_STD_MIN, LOG_STD_MAX = -20.0, 2.0

#: Observations are of the size of one; up to here no sum in a network may overflow.
LARGEST_OBSERVATION = 1e3


class PolicyError(UserError, ValueError):
    """A policy file that cannot be used; the message names the file and the fix."""


def check_layers(layers: Sequence[Layer], what: str, lead: tuple[int, ...], ends: tuple[int, int]) -> None:
    """Refuse layers that do not fit each other, or are not finite, or do not lead from and to the widths ``ends``.

    Raises:
        PolicyError: as said.
    """
    width = None
    reach = np.full(layers[0][0].shape[-2:-1], LARGEST_OBSERVATION)
    for weight, bias in layers:
        if weight.ndim != len(lead) + 2 or weight.shape[:-2] != lead or width not in (None, weight.shape[-2]):
            raise PolicyError(f"the policy's {what}: the layers do not fit each other")
        if bias.shape != (*lead, weight.shape[-1]):
            raise PolicyError(f"the policy's {what}: a bias does not fit its layer")
        if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
            raise PolicyError("the policy's weights are not finite: its training diverged")
        width = weight.shape[-1]
        reach = np.einsum("...i,...io->...o", reach, np.abs(weight, dtype=np.float64)) + np.abs(bias)
    if not (reach < np.finfo(np.float32).max).all():
        raise PolicyError("the policy's weights are so large that its actions overflow: its training diverged")
    found = (layers[0][0].shape[-2], layers[-1][0].shape[-1])
    if found != ends:
        raise PolicyError(f"the policy's {what} is {found[0]} -> {found[1]}, its parameters need {ends}")


def read_layers(archive: Mapping[str, np.ndarray], prefix: str) -> list[Layer]:
    """The layers ``PREFIXweight_0``, ``PREFIXbias_0``, .. of an archive, float32.

    Raises:
        ValueError: one is not of floats; KeyError: one is missing.
    """
    count = sum(name.startswith(f"{prefix}weight_") for name in archive)

    def floats(name: str) -> np.ndarray:
        if archive[name].dtype.kind != "f":
            raise ValueError(f"{name} does not hold floats")
        with np.errstate(over="ignore"):  # what becomes infinite is refused with the rest
            return archive[name].astype(np.float32)

    return [(floats(f"{prefix}weight_{i}"), floats(f"{prefix}bias_{i}")) for i in range(count)]


@dataclass(frozen=True)
class Policy:
    """A squashed-Gaussian actor.

    Attributes:
        layers: (weight (inputs, outputs), bias (outputs,)) float32; ReLU between, 2 x action size outputs at the end:
            mean and log of the deviation before tanh.
        parameters: the MDP that it was trained on.
        about: where it comes from (config, seed, git commit, scores ...); JSON values.
        critic: (weight (critics, inputs, outputs), bias (critics, outputs)) float32 of critics side by side, twins as
            a rule: observation and action -> value; ReLU between. Empty when there are none.
        plug_ins: what of that MDP is a user's own. Where they alter what it sees or does, it acts in the environment
            of its training alone: compiled meshing knows nothing of them.
    """

    layers: Sequence[Layer]
    parameters: MeshingParameters
    about: Mapping[str, Any] = field(default_factory=dict)
    critic: Sequence[Layer] = ()
    plug_ins: PlugIns = NONE

    def __post_init__(self) -> None:
        from envs.mdp.observation import observation_size  # with the compiled code, which is slow to import

        seen, acted = observation_size(self.parameters), self.parameters.action_size
        if self.plug_ins.alter:
            seen, acted = self.layers[0][0].shape[0], self.layers[-1][0].shape[-1] // 2
        check_layers(self.layers, "network", (), (seen, 2 * acted))
        if self.critic:
            check_layers(self.critic, "critic", self.critic[0][0].shape[:-2], (seen + acted, 1))

    def _outputs(self, obs: np.ndarray) -> np.ndarray:
        x = obs
        for weight, bias in self.layers[:-1]:
            x = np.maximum(x @ weight + bias, 0.0)
        weight, bias = self.layers[-1]
        return x @ weight + bias

    def act(self, obs: np.ndarray, sample: np.ndarray | bool, random: np.random.Generator) -> np.ndarray:
        """Actions for a batch.

        Args:
            obs: (batch, observation size) float32.
            sample: for each row, or for all, whether to draw from the distribution or take its squashed mean.
            random: where the noise comes from.

        Returns:
            (batch, action size) float32 in [-1, 1].
        """
        mean, log_std = np.split(self._outputs(obs), 2, axis=1)
        noise = random.standard_normal(mean.shape, dtype=np.float32)
        noise *= np.broadcast_to(np.asarray(sample), len(obs))[:, None]
        return np.tanh(mean + np.exp(np.clip(log_std, LOG_STD_MIN, LOG_STD_MAX)) * noise)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the policy to ``path``; the file appears whole or not at all."""
        about: dict[str, Any] = {"parameters": asdict(self.parameters), "about": dict(self.about)}
        if self.plug_ins != NONE:
            about["plug_ins"] = asdict(self.plug_ins)
        arrays = {f"weight_{i}": weight for i, (weight, _) in enumerate(self.layers)}
        arrays |= {f"bias_{i}": bias for i, (_, bias) in enumerate(self.layers)}
        arrays |= {f"critic_weight_{i}": weight for i, (weight, _) in enumerate(self.critic)}
        arrays |= {f"critic_bias_{i}": bias for i, (_, bias) in enumerate(self.critic)}
        with replacing(Path(path)) as draft, open(draft, "wb") as file:
            np.savez(file, about=np.array(json.dumps(about)), **arrays)  # type: ignore[arg-type]

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, altered: bool = False) -> Policy:
        """Read a policy.

        Args:
            path: a file that `save` wrote.
            altered: also one that plug-ins keep from compiled meshing, and with the names of its plug-ins; else a file
                cannot name what is imported.

        Raises:
            PolicyError: no such file, not a policy, or one that plug-ins keep from compiled meshing.
        """
        if not os.path.isfile(path):
            raise PolicyError(f"{path}: no such policy file; train one with `freemesh train`, or check the path")
        try:
            archive = read_arrays(path)
            text = json.loads(str(archive["about"]))
            layers, critic = read_layers(archive, ""), read_layers(archive, "critic_")
            parameters, about = MeshingParameters(**text["parameters"]), dict(text["about"])
            policy = cls(layers, parameters, about, critic, plug_ins_of(text.get("plug_ins", {})))
        except UNREADABLE as error:
            reason = " ".join(str(error).split())[:200]
            raise PolicyError(
                f"{path}: not a policy file ({reason}); give the policy.npz that a training wrote"
            ) from error
        if altered:
            return policy
        check_unaltered(policy, str(path))
        return replace(policy, plug_ins=NONE)


def check_unaltered(policy: Policy, name: str = "the policy") -> None:
    """Refuse a policy that compiled meshing would mislead.

    Raises:
        PolicyError: plug-ins alter what it sees or does.
    """
    if policy.plug_ins.alter:
        raise PolicyError(
            f"{name}: was trained with {policy.plug_ins}, and meshes in that environment alone: its training's meshes "
            "lie in its run's folder"
        )


def plug_ins_of(fields: Mapping[str, Any]) -> PlugIns:
    """The plug-ins that a policy's file names.

    Raises:
        ValueError: they are no names.
    """
    wrappers = tuple(fields.get("wrappers", ()))
    found = PlugIns(fields.get("reward"), fields.get("observe"), wrappers)
    if not all(name is None or is_spec(name) for name in (found.reward, found.observe, *wrappers)):
        raise ValueError("plug-ins are no names")
    return found
