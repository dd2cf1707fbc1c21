"""Pages of images: contact sheets of streets, sweeps of attributes, assets."""
