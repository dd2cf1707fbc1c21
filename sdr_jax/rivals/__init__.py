"""Searches that SDR is compared with."""
