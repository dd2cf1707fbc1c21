"""The paper's study of assets and images: what half the assets, or fewer images, cost."""
