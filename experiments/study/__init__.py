"""The common frame of every study: plan, jobs, report."""
