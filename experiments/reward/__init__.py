"""One evaluation: render a dataset, train a net, score it; and the memory of all that were made."""
