"""What the search loses without one of its parts."""
