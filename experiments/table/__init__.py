"""The paper's table 2: what nets trained on one set after another are worth on the target's test images."""
