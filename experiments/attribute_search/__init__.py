"""The search: rewards from workers, and one jitted step for each update."""
