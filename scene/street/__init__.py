"""Streets: lines of objects along a road, and the camera that drives down it."""
