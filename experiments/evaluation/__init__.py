"""Evaluations: a `Job` is a network to train and test, a `Result` its outcome; a `Runner` makes them."""
