"""An embedded Ray for one command: quiet, local, its user's alone, watched, and gone when the command is."""

from freemesh_ray.local_ray.private_folder import private_folder
from freemesh_ray.local_ray.session import Session
from freemesh_ray.local_ray.start import local_ray
from freemesh_ray.local_ray.variables import environment, own_folder

__all__ = ["Session", "environment", "local_ray", "own_folder", "private_folder"]
