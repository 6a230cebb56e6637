"""Meshing over HTTP, on Ray Serve: polygons are posted, meshes answered.

    client -> Serve's proxy -> Surface (HTTP, one) -> Mesher (as many as wanted) -> a worker process each

The surface bounds, checks and counts; it never touches a polygon. Whatever may take long, parsing included, happens in
a worker process that the operating system ends when the time is up.
"""
