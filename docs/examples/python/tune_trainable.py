"""A grid of discounts, run by Ray Tune."""

from ray import tune

import freemesh_ray

space = {"curriculum.stages": ["T1"], "budget.env_steps": 50_000, "learner.gamma": tune.grid_search([0.9, 0.99])}
checkpoints = tune.CheckpointConfig(checkpoint_frequency=1, num_to_keep=2)
run = tune.RunConfig(name="discounts", checkpoint_config=checkpoints)
judge = tune.TuneConfig(metric="eval_deterministic/return", mode="max")
results = tune.Tuner(freemesh_ray.trainable, param_space=space, run_config=run, tune_config=judge).fit()
print(results.get_best_result().path)
