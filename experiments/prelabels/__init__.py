"""Pre-labels for annotation tools: what a net sees in images, for people to correct."""
