"""Parts from which several families of assets are built."""
