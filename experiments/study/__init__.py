"""The skeleton of every command: plan, jobs, report."""
