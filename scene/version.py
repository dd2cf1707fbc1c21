"""The version of the engine's pictures.

Raise ``ENGINE`` by one whenever the same attributes, seed and settings give other pictures or labels than
before: new assets, another order of random draws, other shading. ``tests/scene/test_version.py`` fails until
that is done and its golden figures are written anew (its first lines say how). Datasets record the number,
and an export that another engine began is refused. Records of evaluations have it, too: also raise it if the
same recipe gives other nets (2: nets, not pictures).
"""

ENGINE = 9
MAKERS = ("numpy", "numba", "embreex", "opencv-python-headless")
"""Libraries that make pictures: random numbers, compiled shading, rays, the camera's blur and JPEG. With
another version of one of them the same settings may give other bytes."""
