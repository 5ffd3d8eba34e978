#!/usr/bin/env python3
"""Packs random scenes for training: one .npy an array, in shards that training may already read."""
import argparse
import os
import sys
import time
from functools import partial

import numpy as np
import torch

import motion
from events import histogram, keypoints, normalise, unet_edges
from model import PAPER, spread_keypoints
from prior import Prior
from scenes import load_photos
from simulate import EXPOSURE_US, UNIFORM_TIMES, make_scene, quantise
from video import Videos

BINS, KEYPOINTS = 40, 10    # of the E-CIR network
EXTRA_TIMES = 6             # random frame times beside the even ones, for E-CIR
TARGETS = 6                 # random frame times for the fusion network


def curve_arrays(source, seed, index, size, travel=None):
    """Arrays of the E-CIR network for one scene."""
    rng = np.random.default_rng([seed, index, 2])
    times = np.sort(np.concatenate([np.linspace(-1, 1, UNIFORM_TIMES), rng.uniform(-1, 1, EXTRA_TIMES)]))
    scene = make_scene(source, seed, index, size, travel, times, fit=True)
    tau = normalise(scene.t, 0, EXPOSURE_US)
    counts = histogram(tau, scene.x, scene.y, scene.p, unet_edges(PAPER, BINS), size, PAPER)
    between = histogram(tau, scene.x, scene.y, scene.p, scene.times, size, PAPER)
    points = keypoints(scene.t, scene.x, scene.y, 0, EXPOSURE_US, KEYPOINTS, size, PAPER)
    slope = np.polynomial.chebyshev.chebder(scene.fit.astype(np.float64))
    spread = spread_keypoints(torch.from_numpy(points)[None])[0].numpy()
    basis = np.polynomial.chebyshev.chebvander(spread, slope.shape[0] - 1)
    derivative = np.einsum("nhwk,khw->nhw", basis, slope)
    return {"blurry": scene.blurry[None], "histogram": np.minimum(counts, 255).astype(np.uint8),
            "between": np.minimum(between, 255).astype(np.uint8),
            "keypoints": np.round(points * 32767).astype(np.int16), "truth": scene.truth,
            "derivative": derivative.astype(np.float16), "times": scene.times.astype(np.float32)}


def assumed_thresholds(rng, sensor):
    """What an estimate might be: wrong by some ten per cent, sometimes by much more."""
    size = np.exp(rng.normal(0, 0.08) if rng.random() < 0.85 else rng.uniform(np.log(0.65), np.log(1.5)))
    apart = np.exp(rng.normal(0, 0.025))
    size /= 1 - sensor.lost     # an estimator sees the events that are left
    return np.array([sensor.positive * size * apart, sensor.negative * size / apart], np.float32)


def fusion_arrays(source, seed, index, size, travel=None, even=False):
    """Arrays of the fusion network for one scene; even: frames at the anchors, not at random times."""
    rng = np.random.default_rng([seed, index, 3])
    times = motion.ANCHORS if even else np.sort(np.where(
        rng.random(TARGETS) < 0.12, np.sign(rng.uniform(-1, 1, TARGETS)), rng.uniform(-1, 1, TARGETS)))
    scene = make_scene(source, seed, index, size, travel, times)
    thresholds = assumed_thresholds(rng, scene.sensor)
    prior = Prior(normalise(scene.t, 0, EXPOSURE_US), scene.x, scene.y, scene.p, size, thresholds)
    blurry = scene.blurry / 255.0
    fine = prior.frames(blurry, motion.TIMES)
    # The sharp frames keep the noise of the blurry one: their mean is then what the camera saw.
    noise = np.where((scene.blurry > 1) & (scene.blurry < 251), blurry - scene.mean, 0)
    truth = quantise(scene.truth / 255.0 + noise)
    anchors = fine[::motion.WINDOWS // (len(motion.ANCHORS) - 1)]
    return {"blurry": scene.blurry[None], "truth": truth, "times": times.astype(np.float32),
            "thresholds": thresholds, "anchors": anchors.astype(np.float16),
            "prior": prior.frames(blurry, times).astype(np.float16),
            "surfaces": np.stack([np.round(prior.surfaces(time) * 127) for time in times]).astype(np.int8),
            "counts": np.minimum(prior.counts(motion.ANCHORS), 255).astype(np.uint8),
            "moved": motion.estimate(fine).astype(np.float16)}


def build_shard(make, source, folder, seed, first, count, size):
    """Packs scenes first..first + count - 1 into a folder, complete when it exists."""
    incomplete = folder + ".partial"
    os.makedirs(incomplete, exist_ok=True)
    arrays, start = {}, time.time()
    for i in range(count):
        for name, value in make(source, seed, first + i, size).items():
            if name not in arrays:
                arrays[name] = np.lib.format.open_memmap(os.path.join(incomplete, name + ".npy"), "w+",
                                                         value.dtype, (count,) + value.shape)
            arrays[name][i] = value
        print(f"\r{folder}: {i + 1}/{count} scenes, {(time.time() - start) / (i + 1):.3f} s each  ",
              end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    for array in arrays.values():
        array.flush()
    os.rename(incomplete, folder)


class Shards:
    """The packed scenes of a cache folder, read in place; scenes are numbered over all shards."""

    def __init__(self, cache):
        names = sorted(n for n in os.listdir(cache) if n.isdigit()) if os.path.isdir(cache) else []
        if not names:
            raise FileNotFoundError(f"'{cache}' holds no packed scenes; run pack.py --cache first")
        self.shards = []
        for name in names:
            folder = os.path.join(cache, name)
            self.shards.append({file[:-4]: np.load(os.path.join(folder, file), mmap_mode="r")
                                for file in sorted(os.listdir(folder)) if file.endswith(".npy")})
        self.first = np.cumsum([0] + [len(shard["blurry"]) for shard in self.shards])

    def __len__(self):
        return int(self.first[-1])

    def scene(self, index):
        """Arrays of one scene, by name, as tensors of their own."""
        shard = int(np.searchsorted(self.first, index, "right")) - 1
        return {name: torch.from_numpy(array[index - self.first[shard]].copy())
                for name, array in self.shards[shard].items()}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("network", choices=("ecir", "fusion"))
    pictures = parser.add_mutually_exclusive_group(required=True)
    pictures.add_argument("--images", help="folder of photos")
    pictures.add_argument("--videos", help="folder of sharp videos of 120 frames a second, a folder of frames each "
                                           "(REDS); scenes are then 240x180")
    parser.add_argument("--cache", required=True, help="folder to write, outside the repository")
    parser.add_argument("--scenes", type=int, default=2400)
    parser.add_argument("--first", type=int, default=0, help="index of the first scene, a multiple of --shard")
    parser.add_argument("--shard", type=int, default=200, help="scenes a shard")
    parser.add_argument("--side", type=int, default=160, help="side of a scene in pixels, a multiple of 16")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--travel", type=float, nargs=2, metavar=("LOW", "HIGH"), help="pixels; default: 3 to 100")
    parser.add_argument("--even", action="store_true",
                        help="fusion: frames at the nine anchors, for the loss on their mean (train.py --even)")
    args = parser.parse_args()
    if args.scenes < 1 or args.shard < 1 or args.side < 32 or args.side % 16:
        parser.error("--scenes and --shard must be at least 1, --side a multiple of 16 and at least 32")
    source = load_photos(args.images) if args.images else Videos(args.videos)
    size = (args.side, args.side) if args.images else (180, 240)
    network = curve_arrays if args.network == "ecir" else partial(fusion_arrays, even=args.even)

    def make(source, seed, index, size):
        rng = np.random.default_rng([seed, index, 1])
        return network(source, seed, index, size, rng.uniform(*args.travel) if args.travel else None)
    os.makedirs(args.cache, exist_ok=True)
    for first in range(args.first, args.first + args.scenes, args.shard):
        folder = os.path.join(args.cache, f"{first:06d}")
        if not os.path.isdir(folder):
            build_shard(make, source, folder, args.seed, first, min(args.shard, args.first + args.scenes - first),
                        size)


if __name__ == "__main__":
    main()
