"""The network of core/nn/network.h, its loss and its step, as one writes them in PyTorch: the contestant of training_step.py.

As a program it serves training_step.py: it takes training steps and prints a line of JSON for each, with its times, s, as in metrics.jsonl.
"""

import argparse
import json
import time

import torch
import torch.nn.functional as F
from torch import nn


class ConvUnit(nn.Module):
    def __init__(self, inputs, outputs, kernel, normalized=True):
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, kernel, padding=kernel // 2, bias=not normalized)
        self.norm = nn.BatchNorm2d(outputs) if normalized else nn.Identity()

    def forward(self, x):
        return self.norm(self.conv(x))


def upsample_to(x, like):
    if x.shape[2:] == like.shape[2:]:
        return x
    return F.interpolate(x, size=like.shape[2:], mode="nearest")


class StructureNet(nn.Module):
    """With soft attention; its two inputs are depth and mask."""

    def __init__(self, width):
        super().__init__()
        groups = [[(7, 1), (5, 2)]] + [[(3, f)] * 3 for f in (4, 8, 16, 16)]
        channels, skips, self.encoder = 2, [], nn.ModuleList()
        for group in groups:
            units = nn.ModuleList()
            for kernel, factor in group:
                units.append(ConvUnit(channels, factor * width, kernel))
                channels = factor * width
            self.encoder.append(units)
            skips.append(channels)
        self.bottleneck = nn.ModuleList(nn.ModuleList(ConvUnit(channels, channels, 3) for _ in range(2)) for _ in range(4))
        self.attention = ConvUnit(channels, 1, 1, normalized=False)
        self.decoder = nn.ModuleList()
        for skip in reversed(skips[:4]):
            self.decoder.append(nn.ModuleList(
                ConvUnit(*shape) for shape in ((channels, channels, 3), (channels, channels, 3), (channels, skip, 3), (2 * skip, skip, 1))))
            channels = skip
        self.last = ConvUnit(channels, width, 3)
        self.classifier = ConvUnit(width, 21, 1, normalized=False)

    def forward(self, x):
        skips = []
        for g, group in enumerate(self.encoder):
            if g > 0:
                skips.append(x)
                x = F.max_pool2d(x, 2)
            for unit in group:
                x = F.relu_(unit(x))
        for first, second in self.bottleneck:
            x = x + second(F.relu_(first(F.relu(x))))
        mask = torch.sigmoid(self.attention(x))
        x = x * mask
        for first, second, up, merge in self.decoder:
            skip = skips.pop()
            x = F.relu_(second(F.relu_(first(x))))
            x = F.relu_(up(upsample_to(x, skip)))
            x = F.relu_(merge(torch.cat([x, skip], 1)))
            x = x * upsample_to(mask, x)
        return F.log_softmax(self.classifier(F.relu_(self.last(x))).float(), 1)


class Step:
    """A training step on one batch of made-up depth maps: segmentation loss, AdamW, gradient clipping."""

    def __init__(self, args):
        torch.set_num_threads(args.threads)
        torch.manual_seed(1)
        self.bf16 = args.precision == "bf16"
        self.layout = torch.channels_last if args.layout == "channels_last" else torch.contiguous_format
        self.net = StructureNet(args.width).to(memory_format=self.layout)
        self.optimizer = torch.optim.AdamW(self.net.parameters(), lr=1e-4)
        depth = 1.5 + torch.rand(args.batch, 1, 180, 320)
        mask = (torch.rand_like(depth) > 0.1).float()
        self.input = torch.cat([(depth - 2) * mask, mask], 1).to(memory_format=self.layout)
        self.labels = torch.randint(0, 21, (args.batch, 180, 320))

    def __call__(self):
        clock = [time.perf_counter()]
        if self.bf16:
            with torch.autocast("cpu", torch.bfloat16):
                log_probs = self.net(self.input)
        else:
            log_probs = self.net(self.input)
        clock.append(time.perf_counter())
        loss = F.nll_loss(log_probs, self.labels)
        clock.append(time.perf_counter())
        loss.backward()
        clock.append(time.perf_counter())
        torch.nn.utils.clip_grad_norm_(self.net.parameters(), 1.0)
        self.optimizer.step()
        self.optimizer.zero_grad()
        loss.item()
        clock.append(time.perf_counter())
        return dict(zip(("forward", "loss", "backward", "optim"), (b - a for a, b in zip(clock, clock[1:]))))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--width", type=int, default=8)
    parser.add_argument("--batch", type=int, default=8)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--precision", choices=["fp32", "bf16"], default="fp32")
    parser.add_argument("--steps", type=int, default=3)
    parser.add_argument("--layout", choices=["contiguous", "channels_last"], default="contiguous")
    args = parser.parse_args()
    step = Step(args)
    for _ in range(args.steps):
        print(json.dumps({"step_s": step()}))


if __name__ == "__main__":
    main()
