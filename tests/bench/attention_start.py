#!/usr/bin/env python3
"""What the paper's attention does in the first steps of training, with and without the L2 term of the authors' code: docs/paper.md, "Attention".

    volalign render --config configs/m02.yaml --set data.image_sizes=[80x45] --set data.renderer=cpu --count 1600 -o SAMPLES
    tests/bench/attention_start.py SAMPLES traces.json --seeds 1 2 3 4 5      # several processes may write files of their own
    tests/bench/attention_start.py --plot attention.svg traces.json [MORE.json ...]

Trains m02's network (width 8, no normalisation, Xavier, Adam 0.9/0.99 at 1e-3, batches of 16, float32) on every second pixel of the samples, in PyTorch, so that it
stands apart from volalign's own network and optimiser. Needs NumPy, Pillow and PyTorch.
"""

import argparse
import json
import pathlib

DECAYS = (0.0, 5e-4)


def network(torch, channels=8, classes=21):
    """The layers of core/model/paper_units.cc; forward gives logits [B,K,H,W] and the mask [B,1,H/16,W/16]."""
    nn, functional = torch.nn, torch.nn.functional

    def unit(inside, outside, kernel):
        layer = nn.Conv2d(inside, outside, kernel, padding=kernel // 2)
        nn.init.xavier_uniform_(layer.weight)
        nn.init.zeros_(layer.bias)
        return layer

    class Net(nn.Module):
        def __init__(self):
            super().__init__()
            self.encoder, self.bottleneck, self.decoder = nn.ModuleList(), nn.ModuleList(), nn.ModuleList()
            last, skips = 1, []
            for group in ([(7, 1), (5, 2)], [(3, 4)] * 3, [(3, 8)] * 3, [(3, 16)] * 3, [(3, 16)] * 3):
                units = nn.ModuleList()
                for kernel, factor in group:
                    units.append(unit(last, factor * channels, kernel))
                    last = factor * channels
                self.encoder.append(units)
                skips.append(last)
            for _ in range(4):
                self.bottleneck.append(nn.ModuleList([unit(last, last, 3), unit(last, last, 3)]))
            self.attention = unit(last, 1, 1)
            for skip in reversed(skips[:4]):
                self.decoder.append(nn.ModuleList([unit(last, last, 3), unit(last, last, 3), unit(last, skip, 3), unit(2 * skip, skip, 1)]))
                last = skip
            self.last, self.classifier = unit(last, channels, 3), unit(channels, classes, 1)

        def forward(self, x):
            relu, skips = functional.relu, []
            for g, units in enumerate(self.encoder):
                if g > 0:
                    skips.append(x)
                    x = functional.max_pool2d(x, 2)
                for layer in units:
                    x = relu(layer(x))
            for first, second in self.bottleneck:
                x = x + second(relu(first(relu(x))))
            mask = torch.sigmoid(self.attention(x))
            x = x * mask
            for first, second, up, merge in self.decoder:
                skip = skips.pop()
                x = relu(up(functional.interpolate(relu(second(relu(first(x)))), size=skip.shape[2:])))
                x = relu(merge(torch.cat([x, skip], 1))) * functional.interpolate(mask, size=skip.shape[2:])
            return self.classifier(relu(self.last(x))), mask

    return Net()


def train(folder, seeds, samples):
    import numpy
    import torch
    from PIL import Image
    torch.set_num_threads(1)
    files = sorted(folder.glob("*/*_depth.png"))[:samples]
    depth = numpy.stack([numpy.array(Image.open(file)).astype("float32")[::2, ::2] / 1000 for file in files])
    labels = numpy.stack([numpy.array(Image.open(str(file).replace("_depth", "_labels"))).astype("int64")[::2, ::2] for file in files])
    traces = []
    for seed in seeds:
        for decay in DECAYS:
            torch.manual_seed(seed)
            net = network(torch)
            adam = torch.optim.Adam(net.parameters(), lr=1e-3, betas=(0.9, 0.99), weight_decay=decay)
            rows = []
            for first in range(0, len(files) - 15, 16):
                logits, mask = net(torch.from_numpy(depth[first:first + 16]).unsqueeze(1))
                loss = torch.nn.functional.cross_entropy(logits, torch.from_numpy(labels[first:first + 16]))
                adam.zero_grad()
                loss.backward()
                adam.step()
                rows.append([first, mask.min().item(), mask.mean().item(), mask.max().item(), loss.item()])
            traces.append({"seed": seed, "decay": decay, "rows": rows})
            print(f"seed {seed}, L2 {decay}: mask {rows[-1][1]:.4f} to {rows[-1][3]:.4f}, loss {rows[-1][4]:.3f}", flush=True)
    return traces


def plot(traces):
    """SVG: the mask's mean and range over samples, a panel for each L2 term."""
    width, height, left, gap = 380, 220, 46, 44
    colours = ["#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e"]
    last = max(row[0] for trace in traces for row in trace["rows"])
    svg = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{2 * (width + left) + gap}" height="{height + 100}" font-family="sans-serif" font-size="12">',
           '<rect width="100%" height="100%" fill="white"/>']
    for panel, decay in enumerate(DECAYS):
        x0, y0 = left + panel * (width + left + gap / 2), 30
        title = f"with the authors' L2 term, {decay:g}" if decay else "as the paper states it"
        svg.append(f'<text x="{x0}" y="18" font-size="14">Attention mask, {title}</text>')
        for y in (0, 0.5, 1):
            at = y0 + height * (1 - y)
            svg.append(f'<path d="M{x0} {at}h{width}" stroke="#ddd"/><text x="{x0 - 6}" y="{at + 4}" text-anchor="end">{y:g}</text>')
        for x in range(0, last + 1, 400):
            svg.append(f'<text x="{x0 + width * x / last:.0f}" y="{y0 + height + 16}" text-anchor="middle">{x}</text>')
        svg.append(f'<text x="{x0 + width / 2}" y="{y0 + height + 34}" text-anchor="middle">samples</text>')
        for trace in sorted((t for t in traces if t["decay"] == decay), key=lambda t: t["seed"]):
            colour = colours[(trace["seed"] - 1) % len(colours)]
            point = [[(x0 + width * row[0] / last, y0 + height * (1 - row[k])) for row in trace["rows"]] for k in (1, 2, 3)]
            area = " ".join(f"{x:.1f},{y:.1f}" for x, y in point[0] + point[2][::-1])
            line = " ".join(f"{x:.1f},{y:.1f}" for x, y in point[1])
            svg.append(f'<polygon points="{area}" fill="{colour}" opacity="0.25"/><polyline points="{line}" fill="none" stroke="{colour}" stroke-width="1.5"/>')
            if panel == 0:
                x = left + 80 * (trace["seed"] - 1)
                svg.append(f'<text x="{x}" y="{y0 + height + 62}" fill="{colour}">seed {trace["seed"]}</text>')
    return "\n".join(svg + ["</svg>"]) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("paths", nargs="+", type=pathlib.Path)
    parser.add_argument("--seeds", nargs="+", type=int, default=[1, 2, 3, 4, 5])
    parser.add_argument("--samples", type=int, default=1600)
    parser.add_argument("--plot", type=pathlib.Path)
    arguments = parser.parse_args()
    if arguments.plot:
        arguments.plot.write_text(plot([trace for path in arguments.paths for trace in json.loads(path.read_text())]))
        return
    folder, out = arguments.paths
    out.write_text(json.dumps(train(folder, arguments.seeds, arguments.samples)))


if __name__ == "__main__":
    main()
