"""A training that ends when five evaluations in a row have brought no higher return."""

import freemesh_ray


class Patience(freemesh_ray.Callback):
    """Stops a training that has stopped to learn."""

    best, waited = float("-inf"), 0

    def on_evaluation(self, figures):
        higher = figures["eval_deterministic/return"] > self.best
        self.best = max(self.best, figures["eval_deterministic/return"])
        self.waited = 0 if higher else self.waited + 1
        if self.waited == 5:
            raise freemesh_ray.StopTraining


settings = {"name": "patient", "curriculum.stages": ["T1"], "budget.env_steps": 1_200_000}
run = freemesh_ray.train(settings, callbacks=[Patience()])
print(f"ended at {run.progress.env_steps:,} steps; the best policy is that of step {run.progress.best_steps:,}")
