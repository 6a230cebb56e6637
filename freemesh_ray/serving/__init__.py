"""Meshing over HTTP: polygons are posted, meshes answered.

    command -- watches --> server (HTTP; Ray's driver) --> Mesher (actors, as many as wanted) --> workers, in two lanes

The server limits, checks and counts connections and requests; it never touches a polygon. Whatever may take long,
parsing included, happens in a worker that the operating system ends when its time or its memory is used up. Quick
requests have workers of their own, so that costly ones never hold them up.
"""
