"""The engine's version.

Raise ``ENGINE`` by one whenever the same attributes, seed and settings give other images or labels, as with
new assets, another order of random draws or other shading, or when the same recipe trains other networks.
``tests/scene/test_version.py`` fails until it is raised and the recorded figures are updated (its first lines
say how). Datasets record the number, and an export that another engine began is refused; records of
evaluations have it, too.
"""

ENGINE = 9
MAKERS = ("numpy", "numba", "embreex", "opencv-python-headless")
"""Libraries that make images: random numbers, compiled shading, rays, the camera's blur and JPEG. With
another version of one of them the same settings may give other bytes."""
