"""Models of the reward, and the search methods that use them."""
