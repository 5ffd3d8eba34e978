#!/usr/bin/env python3
"""Training scenes from still photos: smooth camera motion, ESIM events, blurry frame and truth.

A scene is a pure function of (photos, seed, index). Intensities are display-referred, as in the
paper's data; travel is the mean path length of the picture's points in pixels per exposure.
"""
import argparse
import glob
import os
import sys
import time
from dataclasses import dataclass

import cv2
import numpy as np
import torch

from events import histogram, keypoints, normalise, unet_edges
from model import PAPER, spread_keypoints

EXPOSURE_US = 120000
LOG_EPS = 0.01
UNIFORM_TIMES, EXTRA_TIMES = 14, 6
DEGREE = 10     # of the polynomial fitted to the sharp sub-frames (n = 10 derivatives)
BINS, KEYPOINTS = 40, 10
GRID = np.linspace(-1.0, 1.0, 513)


@dataclass
class Scene:
    """One exposure: 8-bit frames, events in microseconds since its start, normalised times."""
    blurry: np.ndarray    # uint8 [H, W]
    times: np.ndarray     # float64 [T], ascending; holds linspace(-1, 1, 14)
    truth: np.ndarray     # uint8 [T, H, W]
    t: np.ndarray         # int64 [E], ascending
    x: np.ndarray
    y: np.ndarray
    p: np.ndarray         # 0 or 1
    fit: np.ndarray       # float32 [DEGREE + 1, H, W], Chebyshev coefficients of the sharp curve
    travel: float


def load_photos(folder):
    """Grey photos of a folder as float32 [0, 1]; exits with advice when there are none."""
    files = sorted(f for kind in ("png", "jpg", "jpeg") for f in glob.glob(os.path.join(folder, "*." + kind)))
    photos = [cv2.imread(f, cv2.IMREAD_GRAYSCALE) for f in files]
    for name, photo in zip(files, photos):
        if photo is None:
            sys.exit(f"simulate: {name} cannot be decoded; remove it from the folder")
    if not photos:
        sys.exit(f"simulate: no .png or .jpg pictures in '{folder}'; pass a folder of photos with --images")
    return [photo.astype(np.float32) / 255 for photo in photos]


def random_motion(rng, size, travel):
    """Four rows over GRID: shift x, shift y (pixels), angle (radians), log zoom."""
    height, width = size
    if rng.random() < 0.35:     # shake: reverses inside the exposure
        omega, phase = rng.uniform(1.2, 7.0, 2), rng.uniform(0, 2 * np.pi, 2)
        velocity = np.cos(omega[:, None] * GRID + phase[:, None]) * rng.uniform(0.2, 1.0, (2, 1))
    else:                       # sweep along a bending line with changing speed
        heading = rng.uniform(0, 2 * np.pi) + rng.uniform(-0.9, 0.9) * GRID
        speed = np.exp(rng.uniform(0, 0.9) * np.sin(rng.uniform(0.5, 4.0) * GRID + rng.uniform(0, 2 * np.pi)))
        velocity = speed * np.stack([np.cos(heading), np.sin(heading)])
    turn = np.cos(rng.uniform(0.3, 4.0, (2, 1)) * GRID + rng.uniform(0, 2 * np.pi, (2, 1)))
    strength = rng.uniform(0, 0.5, (2, 1)) * (rng.random((2, 1)) < 0.6)
    rate = np.concatenate([velocity, strength * turn / (0.5 * np.hypot(height, width))])
    path = np.concatenate([np.zeros((4, 1)), np.cumsum(0.5 * (rate[:, 1:] + rate[:, :-1]), 1)], 1)
    path -= path[:, GRID.size // 2][:, None]
    points = np.array([(0, 0), (-.35, -.35), (.35, -.35), (-.35, .35), (.35, .35)]) * (width, height)
    for _ in range(3):          # the path's length is almost linear in its scale
        moved = np.stack([transform(path[:, i], 1.0, (0, 0))[:, :2] @ points.T
                          + path[:2, i, None] for i in range(0, GRID.size, 4)])
        length = np.hypot(*np.diff(moved, axis=0).transpose(1, 0, 2)).sum(0).mean()
        path *= travel / max(length, 1e-9)
    return path


def transform(state, zoom, origin):
    """2x3 matrix from centred picture coordinates to the photo: rotate, scale, shift, origin."""
    shift_x, shift_y, angle, log_zoom = state
    scale = zoom * np.exp(log_zoom)
    c, s = scale * np.cos(angle), scale * np.sin(angle)
    return np.array([[c, -s, origin[0] + zoom * shift_x], [s, c, origin[1] + zoom * shift_y]])


class Layer:
    """A photo seen through a moving window of `size` pixels, `zoom` photo pixels to a pixel."""

    def __init__(self, rng, photo, size, path, zoom, origin=None):
        self.size, self.path, self.zoom = size, path, zoom
        # The window samples every zoom-th pixel: low-pass first, or edges flicker as they move.
        self.photo = cv2.GaussianBlur(photo, (0, 0), 0.38 * zoom)
        reach = np.abs(path[:2]).max(1) + (size[1] / 2, size[0] / 2)
        extent = np.array(photo.shape[::-1], float)
        low = np.minimum(reach * zoom, extent / 2)
        self.origin = low + rng.random(2) * (extent - 2 * low) if origin is None else origin

    def render(self, time):
        """Frame at a normalised time, float32 [H, W]."""
        state = [np.interp(time, GRID, row) for row in self.path]
        matrix = transform(state, self.zoom, self.origin)
        centre = np.array([(self.size[1] - 1) / 2, (self.size[0] - 1) / 2])
        matrix[:, 2] -= matrix[:, :2] @ centre
        return cv2.warpAffine(self.photo, matrix, self.size[::-1], borderMode=cv2.BORDER_REFLECT_101,
                              flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)


def random_mask(rng, size):
    """Soft-edged random shape in the middle of a black canvas, float32 [2 H, 2 W]."""
    mask = np.zeros((2 * size[0], 2 * size[1]), np.float32)
    centre = np.array([size[1], size[0]])
    if rng.random() < 0.5:
        corners = rng.integers(3, 10)
        angle = np.sort(rng.uniform(0, 2 * np.pi, corners))
        radius = min(size) * rng.uniform(0.15, 0.5, corners)
        outline = centre + np.stack([radius * np.cos(angle), radius * np.sin(angle)], 1)
        cv2.fillPoly(mask, [outline.astype(np.int32)], 1.0)
    else:
        axes = (min(size) * rng.uniform(0.12, 0.45, 2)).astype(int).tolist()
        cv2.ellipse(mask, centre.tolist(), axes, float(rng.uniform(0, 180)), 0, 360, 1.0, -1)
    return mask


def random_renderer(rng, photos, size, travel):
    """Function time -> sharp frame [H, W] in [0, 1] of a random scene."""
    def layer(motion):
        photo = photos[rng.integers(len(photos))]
        room = min(photo.shape) / (max(size) + 0.5 * min(travel, 40))
        return Layer(rng, photo, size, motion, rng.uniform(1.0, np.clip(room, 1.0, 2.6)))

    background = layer(random_motion(rng, size, travel))
    gain, offset = (rng.uniform(0.3, 1.0), rng.uniform(0, 0.05)) if rng.random() < 0.4 else (1.0, 0.0)
    if rng.random() > 0.3:
        return lambda time: np.minimum(gain * background.render(time) + offset, 1)
    motion = random_motion(rng, size, rng.uniform(3, max(travel, 12)))
    surface = layer(motion)
    centre = np.array(size[::-1]) * rng.uniform(0.7, 1.3, 2)
    cutout = Layer(rng, random_mask(rng, size), size, motion, 1.0, centre)

    def render(time):
        alpha = cutout.render(time)
        frame = background.render(time) * (1 - alpha) + surface.render(time) * alpha
        return np.minimum(gain * frame + offset, 1)
    return render


class EventSensor:
    """ESIM: an event whenever the log intensity leaves its pixel's last level by a threshold."""

    def __init__(self, rng, size):
        self.rng, self.size = rng, size
        base = rng.uniform(0.18, 0.22) if rng.random() < 0.6 else rng.uniform(0.12, 0.35)
        ratio = rng.uniform(1.0, 1.2) if rng.random() < 0.5 else 1.0
        thresholds = [base, base * ratio] if rng.random() < 0.5 else [base * ratio, base]
        self.positive, self.negative = thresholds
        self.sigma = 0.03
        self.refractory_us = rng.choice([0.0, 100.0, 500.0])
        self.noise_hz = rng.choice([0.0, 0.1, 0.5])
        self.warm = rng.random() < 0.5     # the sensor ran before the exposure started

    def draw(self, mean, count):
        return np.maximum(self.rng.normal(mean, self.sigma, count), 0.01).astype(np.float32)

    def run(self, frames, times_us):
        """Sorted t (int64 microseconds), x, y, p (0/1) for an iterable of frames and their times."""
        pixels = self.size[0] * self.size[1]
        up, down = self.draw(self.positive, pixels), self.draw(self.negative, pixels)
        last = np.full(pixels, -np.inf)
        found, previous, level = [], None, None
        for frame, now in zip(frames, times_us):
            current = np.log(frame.ravel() + np.float32(LOG_EPS))
            if previous is None:
                previous, level, before = current, current.copy(), now
                if self.warm:
                    level += self.rng.uniform(-down, up).astype(np.float32)
                continue
            change = current - level
            active = np.flatnonzero((change >= up) | (change <= -down))
            while active.size:
                change = current[active] - level[active]
                rising = change > 0
                step = np.where(rising, up[active], -down[active])
                hit = np.abs(change) >= np.abs(step)
                active, rising, step = active[hit], rising[hit], step[hit]
                level[active] += step
                slope = current[active] - previous[active]
                share = np.divide(level[active] - previous[active], slope,
                                  out=np.ones_like(slope), where=slope != 0)
                when = before + np.clip(share, 0, 1) * (now - before)
                seen = when - last[active] >= self.refractory_us
                found.append((when[seen], active[seen], rising[seen]))
                last[active[seen]] = when[seen]
                up[active] = self.draw(self.positive, active.size)
                down[active] = self.draw(self.negative, active.size)
            previous, before = current, now
        count = self.rng.poisson(self.noise_hz * 1e-6 * EXPOSURE_US * pixels)
        found.append((self.rng.uniform(0, EXPOSURE_US, count), self.rng.integers(0, pixels, count),
                      self.rng.random(count) < 0.5))
        t, index, p = (np.concatenate(part) for part in zip(*found))
        t = np.clip(np.round(t), 0, EXPOSURE_US).astype(np.int64)
        order = np.argsort(t, kind="stable")
        index = index[order]
        return t[order], index % self.size[1], index // self.size[1], p[order].astype(np.int64)


def quantise(frame):
    return np.clip(np.round(frame * 255), 0, 255).astype(np.uint8)


def make_scene(photos, seed, index, size, travel=None):
    """The scene of (seed, index), size = (H, W); travel in pixels is drawn from 3..70 if None."""
    rng = np.random.default_rng([seed, index])
    drawn = np.exp(rng.uniform(np.log(3), np.log(70)))
    drawn = rng.uniform(3, 70) if rng.random() < 0.5 else drawn
    travel = drawn if travel is None else travel
    render = random_renderer(rng, photos, size, travel)
    sensor = EventSensor(rng, size)
    steps = int(np.clip(np.ceil(3.2 * travel), 80, 256))
    grid = np.linspace(-1, 1, steps)
    frames = np.stack([render(time) for time in grid])
    t, x, y, p = sensor.run(frames, (grid + 1) / 2 * EXPOSURE_US)
    weight = np.full(steps, 1.0 / (steps - 1), np.float32)  # trapezoid rule of equation 3
    weight[[0, -1]] /= 2
    flat = frames.reshape(steps, -1)
    blurry = (weight @ flat).reshape(size)
    if rng.random() < 0.4:
        blurry = blurry + rng.normal(0, rng.uniform(0.2, 1.5) / 255, size)
    to_fit = np.linalg.pinv(np.polynomial.chebyshev.chebvander(grid, DEGREE)).astype(np.float32)
    fit = (to_fit @ flat).reshape((DEGREE + 1,) + size)
    times = np.sort(np.concatenate([np.linspace(-1, 1, UNIFORM_TIMES), rng.uniform(-1, 1, EXTRA_TIMES)]))
    truth = np.stack([quantise(render(time)) for time in times])
    return Scene(quantise(blurry), times, truth, t, x, y, p, fit, travel)


def pack(scene):
    """Training arrays of a scene, small enough for a file of thousands (see PACKED)."""
    size = scene.blurry.shape
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


def build_cache(photos, folder, seed, count, size, first=0):
    """Packs scenes first..first + count - 1, one .npy per array, into a folder of its own."""
    os.makedirs(folder, exist_ok=True)
    arrays, start = {}, time.time()
    for i in range(count):
        packed = pack(make_scene(photos, seed, first + i, size))
        for name, value in packed.items():
            if name not in arrays:
                arrays[name] = np.lib.format.open_memmap(os.path.join(folder, name + ".npy.partial"), "w+",
                                                         value.dtype, (count,) + value.shape)
            arrays[name][i] = value
        print(f"\r{i + 1}/{count} scenes, {(time.time() - start) / (i + 1):.3f} s each",
              end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    for name, array in arrays.items():
        array.flush()
        path = os.path.join(folder, name + ".npy")
        os.replace(path + ".partial", path)


def main():
    parser = argparse.ArgumentParser(description="Pack training scenes from still photos.")
    parser.add_argument("--images", required=True, help="folder of photos")
    parser.add_argument("--cache", required=True, help="folder to write, outside the repository")
    parser.add_argument("--scenes", type=int, default=2400)
    parser.add_argument("--crop", type=int, default=128, help="side of a scene in pixels")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    if args.scenes < 1 or args.crop < 32:
        parser.error("--scenes must be at least 1 and --crop at least 32")
    build_cache(load_photos(args.images), args.cache, args.seed, args.scenes, (args.crop, args.crop))


if __name__ == "__main__":
    main()
