"""Models of the reward, and the methods that follow them."""
