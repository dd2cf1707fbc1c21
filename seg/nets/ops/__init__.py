"""The operations of which the nets consist."""
