"""Studies: many trainings that differ in what a file says, run by Ray Tune.

definition (the file) -> plan (its trials) -> runner (Ray Tune) -> trainable (a trial) -> study_folder (what is left)
"""
