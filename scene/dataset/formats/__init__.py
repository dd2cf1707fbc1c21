"""The form of datasets on disk: planes of pixels, segments, and the published layouts."""
