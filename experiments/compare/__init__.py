"""Search methods at equal numbers of rewards."""
