"""Coloured triangles, solids and mesh files."""
