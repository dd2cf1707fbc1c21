"""The files of datasets: planes of pixels, segments, and the published layouts."""
