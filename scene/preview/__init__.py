"""Pictures to look at: contact sheets of streets, sweeps of attributes, pages of assets."""
