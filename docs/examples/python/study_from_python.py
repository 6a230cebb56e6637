"""A study of two discounts, each with two seeds; what came of every trial."""

import freemesh_ray

study = {
    "study": {
        "title": "Discount",
        "seeds": [1, 2],
        "variants": {"near": {"learner.gamma": 0.9}, "far": {"learner.gamma": 0.99}},
    },
    "settings": {"curriculum.stages": ["T1"], "budget.env_steps": 50_000},
}
result = freemesh_ray.study(study, note=print, resume=True)
for trial in result.trials:
    print(trial.label, trial.seed, trial.status, trial.figures.get("eval_deterministic/score"), trial.folder.policy)
print("best:", result.best and result.best.name, "report:", result.folder.report / "report.md")
