"""Make every recorded result by one command from one commit."""
