"""What surfaces look like: patterns, materials, coats of the ground."""
