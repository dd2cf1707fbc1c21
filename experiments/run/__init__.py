"""A job under way: its context, the search, the final nets."""
