"""Named ways to train the networks; change fields with `dataclasses.replace`.

from dataclasses import replace
settings = replace(RECIPES["paper"], net="fcn8s", weights="vgg16.npz")
"""

from dataclasses import replace
from typing import Any

from seg.settings import FILELESS_NETS, TrainSettings

_PAPER = TrainSettings(
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
)

_FROZEN = TrainSettings(
    net="lite0",
    backbone="frozen",
    lr=1e-2,
    steps=1000,
    batch=4,
    head_dropout=0.2,
    loss_stride=2,
    average=0.6,
)

RECIPES = {
    "compact": TrainSettings(steps=1000),
    "paper": _PAPER,
    "vgg-adam": replace(_PAPER, optimizer="adam", lr=1e-4, weighted=True),
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
    "lite0-frozen": _FROZEN,
    "lite0-heads": replace(
        _FROZEN,
        batch=2,
        loss_stride=4,
        head_width=128,
        heads=3,
        jaccard=1.0,
        last_share=1.0,
        average_mirror=True,
    ),
    "lite0-tuned": TrainSettings(
        net="lite0",
        backbone="tuned",
        lr=1e-3,
        steps=300,
        mix=True,
        noise=True,
        scale=True,
        loss_stride=2,
    ),
}
RECIPES["lite0-full"] = replace(
    RECIPES["lite0-tuned"],
    steps=2000,
    batch=16,
    average=0.2,
    average_mirror=True,
    dtype="bfloat16",
)
"""`compact`: ours. Adam, class weights, mirror images, colours and blur.

`paper`: SGD of section 4 with poly decay, mirroring only, and DeepLab's rates by layer. It is made for
ImageNet weights: without `weights` a network hardly learns anything in 1000 steps.

`vgg-adam`: ours, for ImageNet weights without time for `paper`: Adam and class weights.

`scratch`: ours, for a start without ImageNet weights: Adam, GroupNorm after every convolution, the compact
network's augmentation and class weights.

`lite0-frozen`: ours, for all networks on a frozen backbone: Adam, 1000 steps of 4, class weights, on features
of EfficientNet-Lite0 with ImageNet's weights (Tan and Le, 2019), or of another backbone, of each image and of
one mirrored, coloured and blurred view of it.

`lite0-heads`: ours, for networks that are used and not only compared: three heads of twice the width, the
soft Jaccard loss, batches that end with labelled images alone, logits averaged over heads and the mirror
image. A head's image costs about as much as with `lite0-frozen`, in batches of 2, which fit a CPU's cache.

`lite0-tuned`: ours, for all networks that tune the backbone: 300 steps of 8 with all augmentations; the
backbone trains at a tenth of the head's rate, as is common in fine-tuning, and batch normalisation is
fixed.

`lite0-full`: ours, for a GPU: as `lite0-tuned`, but 2000 steps of 16, in bfloat16; parameters are averaged
over the last fifth of the steps, logits over the mirror image."""


def recipe_for(settings: TrainSettings) -> str:
    """The name of the recipe that suits the network, backbone and weights of some settings."""
    if settings.net == "compact":
        return "compact"
    if settings.has_backbone:
        return "lite0-heads" if settings.heads > 1 else f"lite0-{settings.backbone}"
    if settings.weights is None:
        return "scratch"
    return "paper" if settings.optimizer == "sgd" else "vgg-adam"


def with_net(settings: TrainSettings, **changes: Any) -> TrainSettings:
    """Change network, backbone or weights of settings, and take the recipe that suits them.

    If the recipe stays the same, so do all other fields. Otherwise the new recipe decides them, but for
    `dtype` and `average_mirror`. A number of steps that was not the old recipe's own stays (`with_steps`).

    Args:
        settings: settings of the old network.
        changes: new `net`, `backbone` or `weights`. A network without a backbone loses `backbone`, a network
            that starts from no file loses `weights`.
    """
    changed = replace(settings, **changes)
    if not changed.has_backbone:
        changed = replace(changed, backbone="frozen")
    if changed.net in FILELESS_NETS:
        changed = replace(changed, weights=None)
    if not changed.frozen:
        changed = replace(changed, heads=1)
    recipe = recipe_for(changed)
    return changed if recipe == recipe_for(settings) else _by_recipe(settings, changed, recipe)


def with_heads(settings: TrainSettings, heads: int) -> TrainSettings:
    """Take the recipe `lite0-heads` with so many heads; networks without a frozen backbone stay as they are.

    A number of steps that was not the old recipe's own stays.
    """
    if not settings.frozen:
        return settings
    changed = _by_recipe(settings, settings, "lite0-heads")
    return replace(changed, heads=heads, average_mirror=True)


def _by_recipe(before: TrainSettings, changed: TrainSettings, recipe: str) -> TrainSettings:
    """Take a recipe for the network of changed settings; a number of steps of the user's own stays."""
    new = RECIPES[recipe]
    steps_changed = before.steps != RECIPES[recipe_for(before)].steps
    names = ("net", "backbone", "weights", "dtype", "average_mirror")
    kept = {name: getattr(changed, name) for name in names}
    return with_steps(replace(new, **kept), before.steps if steps_changed else new.steps)


def with_steps(settings: TrainSettings, steps: int) -> TrainSettings:
    """Change the number of steps; a warm-up that does not fit into them becomes a sixth of them."""
    warmup = settings.warmup if settings.warmup < steps else steps // 6
    return replace(settings, steps=steps, warmup=warmup)
