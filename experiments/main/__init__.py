"""The main job: learn the attributes whose rendered images train the best segmentation net."""
