"""An open run folder with its target, workers, stores and progress."""
