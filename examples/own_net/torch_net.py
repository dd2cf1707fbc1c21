"""A small net in PyTorch, trained from nothing on the renders: put your own in its place."""

import numpy as np
import torch
from torch import nn

CLASSES, VOID, STEPS, BATCH = 19, 255, 100, 8


def net() -> nn.Module:
    """Three convolutions that see 15 pixels around, and a class for every pixel."""
    layers: list[nn.Module] = []
    channels = 3
    for dilation in (1, 2, 4):
        layers += [nn.Conv2d(channels, 32, 3, padding=dilation, dilation=dilation), nn.ReLU()]
        channels = 32
    return nn.Sequential(*layers, nn.Conv2d(channels, CLASSES, 1))


def score(
    images: np.ndarray, labels: np.ndarray, real_images: np.ndarray, real_labels: np.ndarray
) -> float:
    """Mean IoU over the real classes."""
    torch.manual_seed(0)
    pixels = torch.from_numpy(images).permute(0, 3, 1, 2).float() / 255 - 0.5
    classes = torch.from_numpy(labels).long()
    model = net()
    optimizer = torch.optim.Adam(model.parameters(), 1e-3)
    for _ in range(STEPS):
        batch = torch.randint(len(pixels), (BATCH,))
        loss = nn.functional.cross_entropy(model(pixels[batch]), classes[batch], ignore_index=VOID)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    with torch.no_grad():
        real = torch.from_numpy(real_images).permute(0, 3, 1, 2).float() / 255 - 0.5
        found = torch.cat([model(one[None]).argmax(1) for one in real]).numpy()
    counts = real_labels != VOID
    ious = []
    for k in np.unique(real_labels[counts]):
        ours, theirs = (found == k) & counts, real_labels == k
        ious.append((ours & theirs).sum() / (ours | theirs).sum())
    return float(np.mean(ious))
