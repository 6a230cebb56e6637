"""The same polygons, boundary segments fixed, through our mesher and its peers, measured alike."""
