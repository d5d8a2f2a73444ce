"""Times a training step of `network: qin2024` in PyTorch on one core: python3 training.py [BATCH]

The same layers, loss and optimizer (AdamW) as in src/surrogate/networks/qin2024.rs, in single precision. Prints a line of JSON: milliseconds
of processor time for each example of an epoch, the least of some.
"""

import json
import sys
import time

import torch
from torch import nn
from torch.nn import functional

BATCH = int(sys.argv[1]) if len(sys.argv) > 1 else 8
EXAMPLES, EPOCHS, SLOPE, GROUPS, COARSE = 256, 4, 0.7, 8, 13


class Mixing(nn.Module):
    """Groups of neighbouring channels, each mixed over all positions by one matrix."""

    def __init__(self):
        super().__init__()
        self.weights = nn.Parameter(torch.randn(GROUPS, COARSE**2, COARSE**2) / COARSE)

    def forward(self, x):
        n, channels = x.shape[:2]
        grouped = x.reshape(n, GROUPS, channels // GROUPS, COARSE**2)
        return torch.einsum("gpq,ngcq->ngcp", self.weights, grouped).reshape(x.shape)


def rectified():
    return nn.LeakyReLU(SLOPE)


def decoder():
    return nn.Sequential(
        nn.Conv2d(64, 32, 3, padding=1),
        rectified(),
        nn.ConvTranspose2d(32, 16, 5, stride=2, padding=2),
        rectified(),
        nn.ConvTranspose2d(16, 1, 5, stride=2, padding=2),
    )


class Network(nn.Module):
    def __init__(self):
        super().__init__()
        self.entry = nn.Sequential(
            nn.Conv2d(1, 16, 10, stride=2, padding=4),
            rectified(),
            nn.Conv2d(16, 32, 7, stride=2, padding=3),
            rectified(),
            nn.Conv2d(32, 64, 5, padding=2),
            rectified(),
        )
        self.adding = nn.ModuleList(nn.Sequential(nn.Conv2d(64, 64, 3, padding=1), rectified()) for _ in range(2))
        self.bottleneck = nn.Sequential(Mixing(), nn.Conv2d(64, 64, 1), rectified())
        self.x, self.y = decoder(), decoder()
        self.auxiliary = nn.Sequential(
            nn.Conv2d(64, 16, 3, padding=1), rectified(), nn.ConvTranspose2d(16, 1, 5, stride=2, padding=2)
        )

    def forward(self, patterns):
        features = self.entry(patterns)
        for layer in self.adding:
            features = features + layer(features)
        features = features + self.bottleneck(features)
        return torch.cat([self.x(features), self.y(features)], 1), self.auxiliary(features)


def loss_of(answer, target):
    field, half = answer
    largest = (field - target).abs().flatten(1).amax(1).sum()
    images = len(target)
    auxiliary = functional.huber_loss(half, target[:, :1, ::2, ::2])
    return functional.huber_loss(field, target) * images + 0.1 * largest + 0.2 * images * auxiliary


def main():
    torch.set_num_threads(1)
    torch.manual_seed(1)
    network = Network()
    optimizer = torch.optim.AdamW(network.parameters(), lr=2e-3, weight_decay=1e-4)
    patterns = (torch.rand(EXAMPLES, 1, 50, 50) < 0.5).float() - 0.5
    targets = torch.zeros(EXAMPLES, 2, 49, 49)
    least = float("inf")
    for _ in range(EPOCHS):
        start = time.thread_time()
        for first in range(0, EXAMPLES, BATCH):
            optimizer.zero_grad()
            answer = network(patterns[first : first + BATCH])
            (loss_of(answer, targets[first : first + BATCH]) / BATCH).backward()
            optimizer.step()
        least = min(least, time.thread_time() - start)
    row = {"code": f"PyTorch {torch.__version__.split('+')[0]}", "batch": BATCH, "ms": 1e3 * least / EXAMPLES}
    print(json.dumps(row))


main()
