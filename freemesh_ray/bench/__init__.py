"""Speeds on the machine at hand: one file for each benchmark, :mod:`freemesh_ray.bench.benchmarks` lists them."""
