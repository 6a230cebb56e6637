"""FreeMesh-v0 in Gymnasium wrappers of a user's; the entry is :mod:`envs.wrappers.wrapped_env`."""
