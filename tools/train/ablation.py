#!/usr/bin/env python3
"""The paper's ablation (table 2) of E-CIR: input sources, video format, refinement.

Trains each row for the same number of steps on the same scenes, measures it on simulated scenes that
it was not trained on (240x180, 14 frames, the benchmark's sensor), and writes a JSON list that
tools/benchmark reads. Rows that are there already are kept: an interrupted run goes on.
"""
import argparse
import json
import os
import subprocess
import sys

import numpy as np
import torch

import task_ecir
from events import network_inputs
from metrics import measure, to_codes
from scenes import load_photos
from sensor import Sensor
from simulate import EXPOSURE_US, UNIFORM_TIMES, make_scene

HERE = os.path.dirname(os.path.abspath(__file__))
ROWS = (    # name, inputs, output, refined
    ("events only", "events", "curve", False),
    ("frame only", "frame", "curve", False),
    ("both", "both", "curve", False),
    ("both, frame-based output", "both", "frames", False),
    ("both, refined", "both", "curve", True),
)
TRAVEL = (4, 60)    # pixels, even over the scenes


def test_scenes(photos, count, size):
    for i in range(count):
        travel = TRAVEL[0] + (TRAVEL[1] - TRAVEL[0]) * (i + 0.5) / count
        yield make_scene(photos, 404, i, size, travel, sensor=Sensor.evaluation)


def evaluate(checkpoint, scenes):
    """Mean NRMSE, PSNR, SSIM over all frames of the scenes."""
    state = torch.load(checkpoint, map_location="cpu")
    model = task_ecir.build(state["config"])
    model.load_state_dict(state["average"])
    model.eval()
    times = np.linspace(-1, 1, UNIFORM_TIMES)
    figures = []
    for scene in scenes:
        counts, points, between = network_inputs(scene.t, scene.x, scene.y, scene.p, 0, EXPOSURE_US,
                                                 scene.blurry.shape, model.variant, model.bins, model.n, times)
        batch = {"blurry": torch.from_numpy(scene.blurry.astype(np.float32) / 255)[None, None],
                 "histogram": torch.from_numpy(counts)[None], "keypoints": torch.from_numpy(points)[None],
                 "times": torch.from_numpy(times)[None]}
        with torch.no_grad():
            frames = task_ecir.initial_frames(model, batch, torch.autocast("cpu", enabled=False))[1]
            if model.refined:
                frames = model.refine(frames, torch.from_numpy(between)[None])[0]
        figures += [measure(to_codes(frame), truth) for frame, truth in zip(frames[0].numpy(), scene.truth)]
    psnr, ssim, nrmse = np.mean(figures, 0)
    return {"nrmse": float(nrmse), "psnr": float(psnr), "ssim": float(ssim)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--cache", required=True, help="training scenes of pack.py ecir")
    parser.add_argument("--validation", required=True, help="validation scenes of pack.py ecir")
    parser.add_argument("--images", required=True, help="folder of photos that are not trained on")
    parser.add_argument("--runs", required=True, help="folder for the training runs")
    parser.add_argument("-o", "--output", required=True, help="JSON file to write")
    parser.add_argument("--steps", type=int, default=1500)
    parser.add_argument("--width", type=int, default=16)
    parser.add_argument("--batch", type=int, default=4)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--scenes", type=int, default=16, help="to measure on")
    parser.add_argument("--size", default="240x180", help="of those, WxH")
    parser.add_argument("--bfloat16", action="store_true", help="as in train.py")
    args = parser.parse_args()
    width, height = (int(side) for side in args.size.split("x"))
    scenes = None
    rows = []
    if os.path.exists(args.output):
        with open(args.output) as file:
            rows = json.load(file)
    for seed in args.seeds:
        for name, inputs, output, refined in ROWS:
            key = {"name": name, "inputs": inputs, "output": output, "refined": refined, "seed": seed,
                   "steps": args.steps, "width": args.width}
            if any(key.items() <= row.items() for row in rows):
                continue
            run = os.path.join(args.runs, f"{inputs}-{output}-{'refined' if refined else 'initial'}-{seed}")
            command = [sys.executable, os.path.join(HERE, "train.py"), "ecir", "--cache", args.cache,
                       "--validation", args.validation, "--run", run, "--steps", str(args.steps), "--minutes", "1e6",
                       "--width", str(args.width), "--batch", str(args.batch), "--seed", str(seed),
                       "--inputs", inputs, "--output", output] + ["--no-refinement"] * (not refined)
            command += ["--bfloat16"] * args.bfloat16
            command += ["--resume"] * os.path.exists(os.path.join(run, "checkpoint.pt"))
            if subprocess.run(command).returncode != 0:
                sys.exit(f"ablation: training of '{name}' failed")
            scenes = scenes or list(test_scenes(load_photos(args.images), args.scenes, (height, width)))
            rows.append({**key, "scenes": args.scenes, **evaluate(os.path.join(run, "checkpoint.pt"), scenes)})
            with open(args.output + ".partial", "w") as file:
                json.dump(rows, file, indent=1)
            os.replace(args.output + ".partial", args.output)
            print({k: rows[-1][k] for k in ("name", "seed", "nrmse", "psnr", "ssim")})


if __name__ == "__main__":
    main()
