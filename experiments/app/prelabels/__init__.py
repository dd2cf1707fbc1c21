"""Pre-labels for annotation tools: labels from a network, for people to correct."""
