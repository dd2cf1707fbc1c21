"""Other search methods, with which SDR is compared."""
