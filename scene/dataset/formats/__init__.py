"""What a dataset looks like on disk: planes of pixels, segments, and the published layouts."""
