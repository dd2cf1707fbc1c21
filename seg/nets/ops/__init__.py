"""What the nets are put together from."""
