"""Trains networks on labelled images plus renders, and measures what the renders add: `sdr-jax fit`."""
