"""What several families of assets are put together from."""
