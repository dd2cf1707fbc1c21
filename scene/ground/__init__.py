"""Road, sidewalk and terrain."""
