"""freemesh-ray: reinforcement learning that meshes polygons, and the experiment platform around it."""

__version__ = "0.1.0"
