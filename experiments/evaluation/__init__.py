"""Evaluations: a `Job` is a net to train and test, a `Result` its outcome; a `Runner` makes them."""
