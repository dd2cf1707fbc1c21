"""Asset families, one file each: a pure generator and a sampler of its parameters."""
