"""A local page with a slider for each attribute and the street that they give."""
