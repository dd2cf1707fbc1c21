"""Which of the 23 attributes matter, and which of them together."""
