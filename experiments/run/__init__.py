"""A running job: its context, the search, the final nets."""
