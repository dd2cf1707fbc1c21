"""Many streets as labelled images: rendered, written, read back, checked."""
