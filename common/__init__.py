"""Files, locks, progress and command lines for all packages.

`sdr_jax`, `scene`, `seg` and `experiments` use it; it imports none of them, and no JAX.
"""
