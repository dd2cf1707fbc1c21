"""A small PyTorch network, trained from scratch on the renders: replace it with your own."""

import numpy as np
import torch
from torch import nn

CLASSES, IGNORE, STEPS, BATCH = 19, 255, 100, 8


def net() -> nn.Module:
    """Three convolutions with a receptive field of 15 pixels, and a class for every pixel."""
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
        loss = nn.functional.cross_entropy(
            model(pixels[batch]), classes[batch], ignore_index=IGNORE
        )
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    with torch.no_grad():
        real = torch.from_numpy(real_images).permute(0, 3, 1, 2).float() / 255 - 0.5
        predictions = torch.cat([model(one[None]).argmax(1) for one in real]).numpy()
    labelled = real_labels != IGNORE
    ious = []
    for k in np.unique(real_labels[labelled]):
        predicted, true = (predictions == k) & labelled, real_labels == k
        ious.append((predicted & true).sum() / (predicted | true).sum())
    return float(np.mean(ious))
