"""The look of surfaces: patterns, materials, coats of the ground."""
