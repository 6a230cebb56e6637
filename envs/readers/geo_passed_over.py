"""The words of Gmsh's scripts that say nothing about an outline, and those that do what no polygon file may."""

#: Statements that leave the outline as it is.
PASSED_OVER = frozenset((
    "Mesh", "General", "Solver", "PostProcessing", "View", "Print", "Printf", "Color", "Recombine", "Characteristic",
    "MeshSize", "Field", "Background", "BoundaryLayer", "Reverse", "ReverseMesh", "Show", "Hide", "Smoother",
    "Periodic", "Save", "Draw", "UnitVector", "SyncModel", "Error", "Warning", "MeshAlgorithm",
    "MeshSizeFromBoundary", "RefineMesh", "RecombineMesh", "RelocateMesh", "OptimizeMesh", "PartitionMesh",
    "RenumberMeshNodes", "RenumberMeshElements", "ReorientMesh", "SetOrder", "SetPartition", "Plugin", "Combine",
    "Alias", "AliasWithOptions", "CopyOptions", "UndefineConstant", "SetNumber", "SetString", "SetName",
    "BoundingBox", "Slide", "Sleep", "SetChanged", "UnsplitWindow", "Homology", "Cohomology", "TransformMesh",
    "CreateTopology", "ClassifySurfaces", "CreateGeometry", "CreateDir", "SetCurrentWindow", "Adapt", "AdaptMesh",
))  # fmt: skip

#: Statements that run programs or read files of other kinds.
REFUSED = frozenset((
    "SystemCall", "NonBlockingSystemCall", "System", "OnelabRun", "OnelabAction", "Open", "Merge",
    "MergeWithBoundingBox", "ShapeFromFile", "ListFromFile", "GetEnv", "Parse", "StringToName", "S2N", "FileExists",
))  # fmt: skip

#: Options of Gmsh have names that begin like this: what they are set to is passed over, what they are is not known.
OPTIONS = frozenset(("Mesh", "General", "Solver", "PostProcessing", "Print", "Geometry", "View", "Field", "Plugin"))

#: What changes a variable.
ASSIGNING = ("=", "+=", "-=", "*=", "/=", "++", "--")
