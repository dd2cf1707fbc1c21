"""Several searches of several methods, each judged as the main job judges its own, in one table."""
