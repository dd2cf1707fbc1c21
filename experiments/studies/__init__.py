"""The paper's experiments and ours, one file each: `sdr-jax study NAME`."""
