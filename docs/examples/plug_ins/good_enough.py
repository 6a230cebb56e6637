"""A callback: the training ends when it completes nine meshes in ten.

callbacks: [good_enough:GoodEnough]
"""

from collections.abc import Mapping

from freemesh_ray.policies.evaluation import COMPLETION
from freemesh_ray.training.callback import Callback, StopTraining


class GoodEnough(Callback):
    def on_evaluation(self, figures: Mapping[str, float]) -> None:
        if figures[COMPLETION] >= 0.9:
            raise StopTraining
