"""Meshing over HTTP, on Ray Serve: polygons are posted, meshes answered.

    client -> Serve's proxy -> Ingress (HTTP, one) -> Mesher (as many as wanted) -> a worker process each

The ingress limits, checks and counts requests; it never touches a polygon. Whatever may take long, parsing included,
happens in a worker process that the operating system ends when the time is up.
"""
