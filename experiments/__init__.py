"""The main job: learn the attributes whose rendered images train the best segmentation net."""

from common.interrupt import while_loading

while_loading(__name__)  # before all else
