"""The meshing world: the MDP of quadrilateral mesh generation as Gymnasium environments.

Importing this package registers ``FreeMesh-v0``. It knows nothing of Ray, torch or MLflow.
"""

from gymnasium.envs.registration import register, registry

if "FreeMesh-v0" not in registry:
    register(
        id="FreeMesh-v0",
        entry_point="envs.mesh_env:MeshEnv",
        vector_entry_point="envs.vector_env:MeshVectorEnv",
    )
