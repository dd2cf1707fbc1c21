"""Reports on this machine, on a folder of labelled images, and on the cost of commands."""
