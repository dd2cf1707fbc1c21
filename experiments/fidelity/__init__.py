"""How much a cheap reward is worth: does it rank attributes as the full size does?"""
