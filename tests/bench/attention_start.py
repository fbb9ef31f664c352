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


def network():
    """m02's, by eager_network.py. The attention's mask is `mask` after each pass."""
    from torch import nn
    from eager_network import ConvUnit, StructureNet

    def unit(*shape):
        layer = ConvUnit(*shape)
        nn.init.xavier_uniform_(layer.conv.weight)
        nn.init.zeros_(layer.conv.bias)
        return layer

    net = StructureNet(8, "none", inputs=1, unit=unit)
    net.attention.register_forward_hook(lambda _, __, logits: setattr(net, "mask", logits.sigmoid()))
    return net


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
            net = network()
            adam = torch.optim.Adam(net.parameters(), lr=1e-3, betas=(0.9, 0.99), weight_decay=decay)
            rows = []
            for first in range(0, len(files) - 15, 16):
                log_probs = net(torch.from_numpy(depth[first:first + 16]).unsqueeze(1))
                loss = torch.nn.functional.nll_loss(log_probs, torch.from_numpy(labels[first:first + 16]))
                adam.zero_grad()
                loss.backward()
                adam.step()
                rows.append([first, net.mask.min().item(), net.mask.mean().item(), net.mask.max().item(), loss.item()])
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
