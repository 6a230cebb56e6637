"""``python -m freemesh_ray`` is the ``freemesh`` command."""

from freemesh_ray.cli.command import main

raise SystemExit(main())
