#!/usr/bin/env python3
"""Figures of a model on simulated scenes by travel, and its frames for a real recording.

PSNR, SSIM and NRMSE are those of 8-bit frames (clipped to [0, 1], times 255, truncated), averaged
over 14 evenly spaced frames of each scene, then over scenes.
"""
import argparse
import csv
import json
import os
import sys

import cv2
import numpy as np
import torch
from skimage.metrics import structural_similarity

from events import network_inputs
from export import load_model
from simulate import EXPOSURE_US, UNIFORM_TIMES, load_photos, make_scene

BANDS = ((5, 10), (10, 20), (20, 40), (40, 60))
KINDS = ("blurry", "initial", "refined")


def to_codes(frame):
    """8-bit codes of a [0, 1] frame, truncated as in the published evaluation."""
    return (np.clip(frame, 0, 1) * 255).astype(np.uint8)


def measure(prediction, truth):
    """PSNR (dB), SSIM and NRMSE of one 8-bit frame; PSNR is inf for identical frames."""
    a, b = prediction.astype(np.float64), truth.astype(np.float64)
    mse = np.mean((a - b) ** 2)
    psnr = 10 * np.log10(255 ** 2 / mse) if mse > 0 else np.inf
    return psnr, structural_similarity(prediction, truth, data_range=255), np.sqrt(mse / np.mean(b ** 2))


def run_model(model, blurry, t, x, y, p, start, end, times):
    """Initial and refined frames, float32 [d, H, W], of one exposure; blurry is 8-bit [H, W]."""
    counts, points, between = network_inputs(t, x, y, p, start, end, blurry.shape, model.variant,
                                             model.bins, model.n, times)
    frame = torch.from_numpy(blurry.astype(np.float32) / 255)
    with torch.no_grad():
        initial, refined = model(frame[None, None], torch.from_numpy(counts)[None],
                                 torch.from_numpy(points)[None], times, torch.from_numpy(between)[None])
    return initial[0].numpy(), refined[0].numpy()


def evaluate_scene(model, scene):
    """Mean PSNR, SSIM, NRMSE of each kind, [3, 3], over the 14 frames of a simulated scene."""
    times = np.linspace(-1, 1, UNIFORM_TIMES)
    truth = [scene.truth[int(np.argmin(np.abs(scene.times - u)))] for u in times]
    initial, refined = run_model(model, scene.blurry, scene.t, scene.x, scene.y, scene.p,
                                 0, EXPOSURE_US, times)
    kinds = ([scene.blurry] * len(times), [to_codes(f) for f in initial], [to_codes(f) for f in refined])
    return np.array([np.mean([measure(f, g) for f, g in zip(frames, truth)], 0) for frames in kinds])


def evaluate(model, photos, size, scenes, seed):
    """One row a band, and all together: band, scenes, and figures [kind][psnr, ssim, nrmse]."""
    rows, every = [], []
    for band, (low, high) in enumerate(BANDS):
        figures = []
        for i in range(scenes):
            travel = low + (high - low) * (i + 0.5) / scenes
            figures.append(evaluate_scene(model, make_scene(photos, seed, 1000 * band + i, size, travel)))
        rows.append((f"{low}-{high} px", len(figures), np.mean(figures, 0)))
        every += figures
    return rows + [(f"{BANDS[0][0]}-{BANDS[-1][1]} px", len(every), np.mean(every, 0))]


def print_table(rows):
    print(f"{'travel':>10} {'scenes':>7}" + "".join(f"  {kind:>8} PSNR   SSIM  NRMSE" for kind in KINDS) + "   gain")
    for name, count, figures in rows:
        print(f"{name:>10} {count:>7}" + "".join(f"  {f[0]:13.2f}  {f[1]:.3f}  {f[2]:.3f}" for f in figures)
              + f"  {figures[2][0] - figures[0][0]:+.2f} dB")


def render_recording(model, folder, output, wanted, frames):
    """Writes blurry, initial and refined frames of exposures of a recording (exposures.csv, events.h5)."""
    import h5py
    with open(os.path.join(folder, "exposures.csv"), newline="") as f:
        exposures = list(csv.DictReader(f))
    with h5py.File(os.path.join(folder, "events.h5")) as f:
        t, x, y, p = (f["events/" + k][:].astype(np.int64) for k in "txyp")
        t = t + (int(f["t_offset"][()]) if "t_offset" in f else 0)
    os.makedirs(output, exist_ok=True)
    times = np.linspace(-1, 1, frames)
    for row in exposures:
        name = os.path.splitext(row["file"])[0]
        if wanted and name not in wanted:
            continue
        blurry = cv2.imread(os.path.join(folder, row["file"]), cv2.IMREAD_GRAYSCALE)
        if blurry is None:
            sys.exit(f"evaluate: {row['file']} named in exposures.csv is not in {folder}")
        initial, refined = run_model(model, blurry, t, x, y, p, int(row["start_us"]), int(row["end_us"]), times)
        for i in range(frames):
            cv2.imwrite(os.path.join(output, f"{name}-{i:02d}-initial.png"), to_codes(initial[i]))
            cv2.imwrite(os.path.join(output, f"{name}-{i:02d}-refined.png"), to_codes(refined[i]))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("model", help="safetensors file")
    parser.add_argument("--images", help="folder of photos that were not trained on")
    parser.add_argument("--size", default="240x180", help="of the simulated scenes, WxH")
    parser.add_argument("--scenes", type=int, default=8, help="for each travel band")
    parser.add_argument("--seed", type=int, default=77)
    parser.add_argument("--json", action="store_true", help="print the table as JSON")
    parser.add_argument("--recording", help="folder with exposures.csv, its pictures and events.h5")
    parser.add_argument("--exposures", nargs="*", help="picture names without suffix (default: all)")
    parser.add_argument("--frames", type=int, default=14)
    parser.add_argument("-o", "--output", help="folder for the recording's frames")
    args = parser.parse_args()
    if bool(args.recording) != bool(args.output) or not (args.images or args.recording):
        parser.error("give --images DIR for figures, or --recording DIR with -o DIR for pictures")
    torch.set_num_threads(int(os.environ.get("OMP_NUM_THREADS", torch.get_num_threads())))
    try:
        width, height = (int(v) for v in args.size.split("x"))
        model, _ = load_model(args.model)
        if args.recording:
            render_recording(model, args.recording, args.output, args.exposures, args.frames)
    except (OSError, ValueError, KeyError) as error:
        sys.exit(f"evaluate: {error}")
    if args.images:
        rows = evaluate(model, load_photos(args.images), (height, width), args.scenes, args.seed)
        if args.json:
            print(json.dumps([{"travel": name, "scenes": count, **{
                kind: dict(zip(("psnr", "ssim", "nrmse"), map(float, f))) for kind, f in zip(KINDS, figures)}}
                for name, count, figures in rows]))
        else:
            print_table(rows)


if __name__ == "__main__":
    main()
