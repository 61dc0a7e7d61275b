"""Torch modules as planners, good ones and bad ones, as a user would write them."""

import torch
from torch import nn


class Careful(nn.Module):
    """A small network, bounded in the end, untrained; the dropout does nothing once it drives."""

    def __init__(self):
        super().__init__()
        torch.manual_seed(0)
        self.each = nn.Sequential(nn.Linear(8, 16), nn.Tanh())
        self.join = nn.Sequential(nn.Linear(21, 32), nn.ReLU(), nn.Dropout(0.5), nn.Linear(32, 2), nn.Tanh())

    def forward(self, ego, others):
        near = self.each(others / 50.0) * others[..., :1]
        return self.join(torch.cat([ego / 50.0, near.amax(dim=1)], dim=1)) * torch.tensor([3.0, 1e-4])


READY = Careful()


class OfManyParts(nn.Module):
    """A module of many usual parts of networks."""

    def __init__(self):
        super().__init__()
        torch.manual_seed(0)
        self.attention = nn.TransformerEncoderLayer(8, 2, 16, batch_first=True)
        self.convolution = nn.Sequential(nn.Conv2d(1, 4, 3, stride=2), nn.BatchNorm2d(4), nn.GELU())
        self.each = nn.Sequential(nn.Conv2d(4, 4, 3, padding=1, groups=4), nn.SiLU(), nn.AdaptiveAvgPool2d(1))
        self.memory = nn.GRUCell(8, 4)
        self.out = nn.Sequential(nn.Linear(8, 8), nn.LayerNorm(8), nn.ELU(), nn.Linear(8, 2))

    def forward(self, ego, others):
        others = others / 50.0
        seen = self.attention(others, src_key_padding_mask=others[..., 0] > 0.3)
        best, _ = seen.max(dim=1)
        felt = torch.zeros(len(ego), 4)
        for row in range(3):
            felt = self.memory(others[:, row], felt)
        picture = self.each(self.convolution(seen[:, None])).flatten(1)
        ahead = torch.atan2(ego[:, 4:], ego[:, 3:4]).clamp(-1.0, 1.0)
        return self.out(torch.cat([picture, felt], dim=1)) + best[:, :2] * seen.norm(dim=(1, 2))[:, None] + ahead


class Sorted(Careful):
    """Torch alone can do that."""

    def forward(self, ego, others):
        return super().forward(ego, others.sort(dim=1)[0])


class Shapeless(Careful):
    def forward(self, ego, others):
        return super().forward(ego, others)[:, :1]


class Raises(Careful):
    """A module whose operations depend on values, so that it does not fit into a compiled loop."""

    def forward(self, ego, others):
        if (ego[:, 0] > 9.9).any():
            raise KeyError("lost")
        return super().forward(ego, others)


NO_MODULE = 7
