"""Pre-labels for annotation tools: a net's labels for people to correct."""
