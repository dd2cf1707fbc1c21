"""Asset families, one file each, with a sampler of parameters and a pure function that builds the mesh."""
