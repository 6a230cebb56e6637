"""``python -m freemesh_ray`` is the ``freemesh`` command."""

from freemesh_ray.cli import main

raise SystemExit(main())
