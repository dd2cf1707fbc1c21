"""Evaluations: a `Job` is a net to be trained and tested, a `Result` its outcome; one `Runner` makes them."""
