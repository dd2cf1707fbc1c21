"""What people use on images of their own, and the commands that learn to simulate, with their reports."""
