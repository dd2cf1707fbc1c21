"""The renderer for graphics cards."""
