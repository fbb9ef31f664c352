#!/usr/bin/env python3
"""Depth of your own frames beside rendered ones: is a sensor model like your sensor? docs/sensor-models.md has a table of it.

    PYTHONPATH=build/release/bindings/python tests/bench/depth_statistics.py [CAPTURE.json ...] [--kind KIND] [--sensors KIND=WIDTHxHEIGHT ...] [--count 48]

Frames of captures belong to the kind of sensor that their capture names, else to KIND. KIND=WIDTHxHEIGHT renders a kind without frames. Printed as Markdown:
- holes lie within the convex hull of the pixels with depth;
- edges: two neighbours with depth, in a row or column, whose depths differ by more than 300 mm, perhaps with a gap of pixels without depth between them;
- flying pixels lie between two surfaces, at 20 to 80 % of the way;
- local residual: lower quartile over 9x9 windows without holes of the root mean square about the plane that fits them (one in inverse depth).
Needs SciPy.
"""

import argparse
import collections
import itertools

import numpy as np
from scipy.spatial import ConvexHull

import volalign

DISTANCES, INCIDENCES, LEAST_WINDOWS, WINDOW, LONGEST_GAP = (1.0, 1.5, 2.0, 2.5, 3.5, 5.5), (0, 40, 60, 80), 60, 9, 60


def rays_of(k):
    """(H, W, 2): X / Z and Y / Z of each pixel, without the lens's tangential part."""
    x, y = np.meshgrid((np.arange(k.width) - k.cx) / k.fx, (np.arange(k.height) - k.cy) / k.fy)
    k1, k2, _, _, k3, k4, k5, k6 = (*k.distortion, *[0] * 8)[:8]
    straight = np.linspace(0, 3, 3001)
    r2 = straight**2
    bent = straight * (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    end = int(np.argmax(np.diff(bent) <= 0)) or len(bent) - 1  # where the lens folds over
    seen = np.hypot(x, y)
    return np.stack([x, y], -1) * (np.interp(seen, bent[: end + 1], straight[: end + 1], right=np.nan) / np.maximum(seen, 1e-12))[..., None]


def hull_area(valid):
    ends = [(u, v) for u in np.flatnonzero(valid.any(0)) for v in np.flatnonzero(valid[:, u])[[0, -1]]]
    return ConvexHull([(u + du, v + dv) for u, v in ends for du in (-0.5, 0.5) for dv in (-0.5, 0.5)]).volume  # in two dimensions, the area


def edges_of(line, gaps):
    places = np.flatnonzero(line)
    for before, last, now in zip([None, *places], places, places[1:]):
        gap, jump = now - last - 1, abs(line[now] - line[last]) > 0.3
        if gap > LONGEST_GAP:
            continue
        if jump:
            gaps["0" if gap == 0 else "1-3" if gap <= 3 else "4-12" if gap <= 12 else "more"] += 1
        if gap == 0 and before == last - 1 and abs(line[now] - line[before]) > 0.3:
            share = (line[last] - line[before]) / (line[now] - line[before])
            if 0.2 < share < 0.8:
                gaps["flying"] += 1
                gaps["0"] += not jump and abs(line[last] - line[before]) <= 0.3


def windows_of(depth, rays, cells):
    starts = range(0, depth.shape[0] - WINDOW + 1, 4), range(0, depth.shape[1] - WINDOW + 1, 4)
    for v, u in itertools.product(*starts):
        z = depth[v : v + WINDOW, u : u + WINDOW].ravel().astype(float)
        ray = rays[v : v + WINDOW, u : u + WINDOW].reshape(-1, 2)
        if z.min() <= 0 or not np.isfinite(ray).all():
            continue
        rows = np.column_stack([ray, np.ones(len(z))])
        plane = np.linalg.lstsq(rows * z[:, None] ** 2, z, rcond=None)[0]  # residuals of 1/z, in depth
        middle = rows[len(z) // 2]
        cosine = abs(plane @ middle) / np.linalg.norm(plane) / np.linalg.norm(middle)
        cell = np.digitize(z.mean(), DISTANCES) - 1, np.digitize(np.degrees(np.arccos(min(cosine, 1))), INCIDENCES) - 1
        cells[cell].append(1000 * np.sqrt(np.sum((z - 1 / (rows @ plane)) ** 2) / (len(z) - 3)))


def statistics(frames):
    """Name of a figure -> text, of (depth, intrinsics)."""
    gaps, cells, pixels, valid, hull = collections.Counter(), collections.defaultdict(list), 0, 0, 0
    for depth, k in frames:
        pixels, valid, hull = pixels + depth.size, valid + np.count_nonzero(depth), hull + hull_area(depth > 0)
        for line in itertools.chain(depth, depth.T):
            edges_of(line, gaps)
        windows_of(depth, rays_of(k), cells)
    edges = sum(gaps[name] for name in ("0", "1-3", "4-12", "more")) or 1
    percent = lambda share: f"{100 * share:.1f} %"
    figures = {"frames": str(len(frames)), "valid pixels": percent(valid / pixels), "field of view (hull)": percent(hull / pixels), "holes inside it": percent(1 - valid / hull)}
    figures |= {f"edges with a gap of {name} px": percent(gaps[name] / edges) for name in ("0", "1-3", "4-12", "more")}
    figures["flying pixels per jump"] = percent(gaps["flying"] / edges)
    for d, i in itertools.product(range(len(DISTANCES) - 1), range(len(INCIDENCES) - 1)):
        if len(cells[d, i]) >= LEAST_WINDOWS:
            figures[f"local residual, {DISTANCES[d]}-{DISTANCES[d + 1]} m, {INCIDENCES[i]}-{INCIDENCES[i + 1]} deg"] = f"{np.quantile(cells[d, i], 0.25):.2f} mm"
    return figures


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("captures", nargs="*")
    parser.add_argument("--kind")
    parser.add_argument("--sensors", nargs="+", default=[])
    parser.add_argument("--count", type=int, default=48)
    parser.add_argument("--recipe", default="configs/m05-lite.yaml")
    arguments = parser.parse_args()
    real = collections.defaultdict(list)
    for frame in (frame for path in arguments.captures for frame in volalign.Capture.load(path).frames):
        real[frame.sensor or arguments.kind or parser.error(f"{frame.name} has no kind of sensor: --kind"), f"{frame.intrinsics.width}x{frame.intrinsics.height}"].append((frame.depth, frame.intrinsics))
    for sensor, size in sorted({*real, *(tuple(named.split("=")) for named in arguments.sensors)}):
        samples = volalign.samples(arguments.recipe, **{"data.sensors": [sensor], "data.image_sizes": [size]})
        sets = {"rendered": statistics([(s.depth, s.intrinsics) for s in itertools.islice(samples, arguments.count)])}
        if real[sensor, size]:
            sets["real"] = statistics(real[sensor, size])
        print(f"\n| {sensor}, {size} | {' | '.join(sets)} |\n|---|{'---|' * len(sets)}")
        for name in dict.fromkeys(name for figures in sets.values() for name in figures):
            print(f"| {name} | {' | '.join(figures.get(name, '-') for figures in sets.values())} |")


if __name__ == "__main__":
    main()
