"""How learners find each other: on a Ray of our own by a file in its folder, where a port would let in whoever asks."""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import ray
from ray.rllib.core.learner import learner_group
from ray.train.torch.config import TorchConfig, _setup_torch_process_group, _TorchBackend

from freemesh_ray.local_ray import own_folder


class _ByFile(_TorchBackend):
    """Makes the process group of learners that share a file system."""

    share_cuda_visible_devices = False

    def on_start(self, worker_group: Any, backend_config: Any) -> None:
        """Have every learner join; one alone needs nobody."""
        count = len(worker_group)
        if count == 1:
            return
        backend = "nccl" if worker_group.get_resources_per_worker().get("GPU", 0) else "gloo"
        joined = [
            worker_group.execute_single_async(
                i, _setup_torch_process_group, backend=backend, world_rank=i, world_size=count,
                init_method=backend_config.file.as_uri(), timeout_s=backend_config.timeout_s,
            )
            for i in range(count)
        ]  # fmt: skip
        ray.get(joined)


class _FileConfig(TorchConfig):
    """What Ray makes a `_ByFile` of."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.file = file

    @property
    def backend_cls(self) -> type[_ByFile]:
        """As said."""
        return _ByFile


@contextmanager
def met_by_file() -> Iterator[None]:
    """Learners that are started in the block find each other by a file, if Ray is one of our own."""
    folder = own_folder()
    if folder is None:
        yield
        return
    before = learner_group._get_backend_config
    learner_group._get_backend_config = lambda learner_class: _FileConfig(folder / f"learners-{uuid.uuid4().hex}")
    try:
        yield
    finally:
        learner_group._get_backend_config = before
