"""Weather, clouds, sun and sky."""
