"""The main job: the training loop, its checkpoints and the folder of a run."""
