"""The renderer for processors."""
