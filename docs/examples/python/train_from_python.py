"""A training that shows its progress, and what it leaves; after Ctrl-C the same script goes on."""

import freemesh_ray

settings = {"name": "t1", "curriculum.stages": ["T1"], "budget": {"env_steps": 60_000}}
run = freemesh_ray.train(settings, callbacks=[freemesh_ray.ProgressLine()], resume=True)
for row in run.evaluations:
    print(f"{row['env_steps']:,} steps: return {row['eval_deterministic/return']:.1f}")
print(run.folder.policy, run.checkpoint, run.folder.curve, run.folder.meshes)
print(freemesh_ray.mesh([[0, 0], [4, 0], [4, 3], [0, 3]], edge_length=0.5, policy=run.policy))
