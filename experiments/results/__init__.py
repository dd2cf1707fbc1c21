"""Every recorded result, made by one command from one commit."""
