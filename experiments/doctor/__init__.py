"""What this machine has, what a folder of labelled images holds, and what commands will cost."""
