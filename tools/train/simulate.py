#!/usr/bin/env python3
"""Scenes for training and evaluation from still photos or sharp videos: events, blurry frame, truth.

A scene is a pure function of (source, seed, index) and the options. The exposure lasts 120 ms; the
blurry frame is the mean of the sharp frames' display-referred values (equation 1 of the paper), cut
at white; travel is the length of the path of the background's translation, in pixels.
"""
import argparse
import csv
import os
import sys
from dataclasses import dataclass

import cv2
import numpy as np

from scenes import StandingPhotos, load_photos
from sensor import Sensor

EXPOSURE_US = 120000
UNIFORM_TIMES = 14
DEGREE = 10     # of the polynomial fitted to the sharp sub-frames (n = 10 derivatives)


@dataclass
class Scene:
    """One exposure: 8-bit frames, events in microseconds since its start, normalised times."""
    blurry: np.ndarray    # uint8 [H, W]
    times: np.ndarray     # float64 [T], ascending
    truth: np.ndarray     # uint8 [T, H, W]
    t: np.ndarray         # int64 [E], ascending
    x: np.ndarray
    y: np.ndarray
    p: np.ndarray         # 0 or 1
    fit: np.ndarray       # float32 [DEGREE + 1, H, W], Chebyshev coefficients of the sharp curve, or None
    mean: np.ndarray      # float32 [H, W], what the blurry frame would be without noise and rounding
    world: object         # scenes.World or video.Video
    sensor: Sensor


def quantise(frame):
    return np.clip(np.round(frame * 255), 0, 255).astype(np.uint8)


def random_travel(rng):
    """3 to 100 pixels, slow scenes as frequent as fast ones."""
    return rng.uniform(3, 100) if rng.random() < 0.5 else np.exp(rng.uniform(np.log(3), np.log(100)))


def make_scene(source, seed, index, size, travel=None, times=None, sensor=Sensor.training, fit=False):
    """The scene of (seed, index), size = (H, W). source: Photos, or Videos (which have their own travel).

    travel: pixels, None for a random one. times: ascending normalised times of the truth, None for
    14 even ones. sensor: function of a generator to a Sensor. fit: also fit the sharp curve.
    """
    rng = np.random.default_rng([seed, index])
    drawn = random_travel(rng)
    world = source.world(rng, size, drawn if travel is None else travel)
    sensor = sensor(rng)
    if sensor.drift is not None:
        world.ramp = sensor.drift
    steps = int(np.clip(np.ceil(3 * world.fastest()), 80, 288))
    grid = np.linspace(-1, 1, steps)
    frames = np.stack([world.render(time) for time in grid])
    t, x, y, p = sensor.events(rng, frames, (grid + 1) / 2 * EXPOSURE_US)
    weight = np.full(steps, 1.0 / (steps - 1), np.float32)  # trapezoid rule of equation 1
    weight[[0, -1]] /= 2
    flat = frames.reshape(steps, -1)
    radiance = (weight @ flat).reshape(size)
    mean, blurry = np.minimum(radiance, 1), sensor.frame(rng, radiance)
    curve = None
    if fit:
        to_fit = np.linalg.pinv(np.polynomial.chebyshev.chebvander(grid, DEGREE)).astype(np.float32)
        curve = (to_fit @ np.minimum(flat, 1)).reshape((DEGREE + 1,) + size)
    times = np.linspace(-1, 1, UNIFORM_TIMES) if times is None else np.asarray(times, np.float64)
    truth = np.stack([quantise(world.render(time)) for time in times])
    return Scene(blurry, times, truth, t, x, y, p, curve, mean, world, sensor)


def write_recording(scene, folder):
    """The scene as `ecir deblur -i FOLDER` reads it: exposures.csv, blurry.png, events.h5; truth beside."""
    import h5py
    os.makedirs(os.path.join(folder, "truth"), exist_ok=True)
    if not cv2.imwrite(os.path.join(folder, "blurry.png"), scene.blurry):
        sys.exit(f"simulate: cannot write {folder}/blurry.png")
    for i, frame in enumerate(scene.truth):
        cv2.imwrite(os.path.join(folder, "truth", f"{i:06d}.png"), frame)
    with h5py.File(os.path.join(folder, "events.h5"), "w") as file:
        for name, kind in (("t", np.int64), ("x", np.uint16), ("y", np.uint16), ("p", np.uint8)):
            file.create_dataset("events/" + name, data=getattr(scene, name).astype(kind), compression="gzip",
                                compression_opts=1, shuffle=True)
    with open(os.path.join(folder, "exposures.csv"), "w", newline="") as file:
        csv.writer(file).writerows([("file", "start_us", "end_us"), ("blurry.png", 0, EXPOSURE_US)])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--images", required=True, help="folder of photos")
    parser.add_argument("-o", "--output", required=True, help="folder for the recordings, one folder a scene")
    parser.add_argument("--scenes", type=int, default=4)
    parser.add_argument("--first", type=int, default=0, help="index of the first scene")
    parser.add_argument("--size", default="240x180", help="WxH")
    parser.add_argument("--travel", type=float, nargs=2, metavar=("LOW", "HIGH"), help="pixels; default: 3 to 100")
    parser.add_argument("--sensor", choices=("evaluation", "training"), default="evaluation")
    parser.add_argument("--standing", action="store_true", help="the camera stands still, objects move")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    try:
        width, height = (int(side) for side in args.size.split("x"))
    except ValueError:
        parser.error(f"--size '{args.size}' is not of the form WxH")
    photos = load_photos(args.images)
    if args.standing:
        photos = StandingPhotos(photos)
    for i in range(args.first, args.first + args.scenes):
        travel = np.random.default_rng([args.seed, i, 1]).uniform(*args.travel) if args.travel else None
        scene = make_scene(photos, args.seed, i, (height, width), travel, sensor=getattr(Sensor, args.sensor))
        folder = os.path.join(args.output, f"{i:06d}")
        write_recording(scene, folder)
        print(f"{folder}: travel {scene.world.travel():.1f} px, fastest {scene.world.fastest():.1f} px, "
              f"{len(scene.t)} events, thresholds "
              f"{scene.sensor.positive:.3f} {scene.sensor.negative:.3f}")


if __name__ == "__main__":
    main()
