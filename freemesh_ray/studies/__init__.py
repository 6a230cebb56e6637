"""Studies: many trainings that differ in what a file says, run by Ray Tune.

definition (the file) -> plan (its trials) -> running (Tuner) -> trial_run (one training) -> folder (what is left)
"""
