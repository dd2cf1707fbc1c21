"""Files, locks, progress and command lines: what touches the world, once for all packages.

The floor below `sdr_jax`, `scene`, `seg` and `experiments`: it imports none of them, and no JAX.
"""
