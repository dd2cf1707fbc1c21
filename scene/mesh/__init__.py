"""What things are made of: coloured triangles, solids, mesh files."""
