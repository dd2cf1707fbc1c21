"""The operations of which the networks consist."""
