"""Scripts that need a checkout: results, the packaged model, images of the pages, conversions."""
