"""What a mesh is to whoever measures, draws or writes it, and its metrics."""
