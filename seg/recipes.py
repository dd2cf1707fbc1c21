"""Named ways to train the VGG nets; change fields with `dataclasses.replace`.

    from dataclasses import replace
    settings = replace(RECIPES["paper"], net="fcn8s", weights="vgg16.npz")

The compact net's recipe is `TrainSettings()`.
"""

from seg.settings import TrainSettings

RECIPES = {
    "paper": TrainSettings(
        net="deeplabv2",
        optimizer="sgd",
        lr=5e-4,
        momentum=0.9,
        weight_decay=1e-4,
        power=0.9,
        warmup=0,
        steps=1000,
        batch=4,
        mirror=True,
        colour=False,
        blur=False,
        weighted=False,
        lr_multipliers="deeplab",
        predict_batch=4,
    ),
    "scratch": TrainSettings(
        net="deeplabv2",
        optimizer="adam",
        lr=1e-3,
        warmup=50,
        steps=1000,
        batch=4,
        norm=True,
        predict_batch=4,
    ),
}
"""`paper`: section 4's SGD with poly decay and mirroring only, and DeepLab's rates by layer. It is made for
ImageNet weights: set `weights`, or hardly anything is learnt in 1000 steps.

`scratch`: ours, where there are no such weights: Adam, GroupNorm after every convolution, the compact net's
augmentation and class weights."""
