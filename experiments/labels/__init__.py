"""What a few labelled images are worth, alone and beside renders."""
