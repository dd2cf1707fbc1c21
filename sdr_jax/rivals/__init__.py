"""Other searches, with which SDR is compared."""
