"""The loop that trains any of the networks: for a given time, resumable, seeded, on CPU or GPU.

A task (task_ecir.py, task_fusion.py) says what a batch is, what is minimised and what is measured.
"""
import csv
import os
import sys
import time

import numpy as np
import torch

from export import write_safetensors
from pack import Shards

SAVE_SECONDS = 360
PAUSE_SECONDS = 20  # a step that took longer was suspended: its time does not count
EVEN_STEPS = 4      # one step in so many sees scenes of --even


class Average:
    """Exponential moving average of a model's floating-point state, which is what ships."""

    def __init__(self, model):
        self.state = {name: value.detach().clone() for name, value in model.state_dict().items()}

    def update(self, model, step):
        decay = min(0.999, (1 + step) / (10 + step))
        with torch.no_grad():
            for name, value in model.state_dict().items():
                if value.is_floating_point():
                    self.state[name].lerp_(value, 1 - decay)
                else:
                    self.state[name].copy_(value)


def learning_rate(args, progress):
    """Linear warm-up over 1 %, then a half cosine down to 1 % of the peak; or the paper's steps."""
    if args.paper:
        return 1e-4 * 0.5 ** ((progress >= 0.4) + (progress >= 0.8))
    peak = args.rate
    warm = min(1.0, 0.02 + progress / 0.01)
    return peak * warm * (0.01 + 0.99 * 0.5 * (1 + np.cos(np.pi * min(progress, 1.0))))


def psnr(frames, truth):
    """dB, mean over all frames N x T x H x W, clipped to [0, 1]; not rounded to 8 bits."""
    return float(-10 * torch.log10((frames.clamp(0, 1) - truth).square().mean((2, 3)) + 1e-8).mean())


def load_checkpoint(path, device):
    try:
        return torch.load(path, map_location=device)
    except OSError as error:
        sys.exit(f"train: cannot read {path}: {error.strerror}")


class Trainer:
    """One run in a folder: checkpoint.pt, model.safetensors (averaged weights, float16), log.csv."""

    def __init__(self, task, args):
        self.task, self.args = task, args
        self.path = os.path.join(args.run, "checkpoint.pt")
        if not args.resume and os.path.exists(self.path):
            sys.exit(f"train: {self.path} exists; add --resume to go on, or choose another --run folder")
        try:
            self.scenes, self.held_out = Shards(args.cache), Shards(args.validation)
            self.even = Shards(args.even) if args.even else None
        except OSError as error:
            sys.exit(f"train: {error}")
        os.makedirs(args.run, exist_ok=True)
        self.step, self.elapsed, self.mean = 0, 0.0, {}
        state = load_checkpoint(self.path, args.device) if args.resume else None
        self.config = state["config"] if state else task.config(args)
        self.model = task.build(self.config).to(args.device, memory_format=torch.channels_last)
        self.optimiser = torch.optim.Adam(self.model.parameters(), args.rate)
        if state:
            self.model.load_state_dict(state["model"])
            self.optimiser.load_state_dict(state["optimiser"])
            self.step, self.elapsed = state["step"], state["elapsed"]
        elif args.start:
            have = load_checkpoint(args.start, args.device)["average"]
            own = self.model.state_dict()
            own.update({k: v for k, v in have.items() if k in own and own[k].shape == v.shape})
            self.model.load_state_dict(own)
        self.average = Average(self.model)
        if state:
            self.average.state = state["average"]
        self.averaged = task.build(self.config).to(args.device, memory_format=torch.channels_last)
        self.log = open(os.path.join(args.run, "log.csv"), "a" if args.resume else "w", newline="")
        self.table = csv.writer(self.log)

    def advance(self, progress):
        """One optimiser step; returns the loss terms."""
        for group in self.optimiser.param_groups:
            group["lr"] = learning_rate(self.args, progress)
        rng = np.random.default_rng([self.args.seed, self.step])
        scenes, count = self.scenes, self.args.batch
        if self.even is not None and self.step % EVEN_STEPS == 0:
            scenes, count = self.even, max(1, count // 4)   # more frames a scene
        chosen = rng.integers(0, len(scenes), count)
        batch = self.task.batch([scenes.scene(int(i)) for i in chosen], rng, self.args.device)
        # The last tenth settles in the precision of inference.
        mixed = self.args.bfloat16 and progress < 0.9
        terms = self.task.losses(self.model, batch, rng, progress, mixed)
        weights = self.task.PAPER_WEIGHTS if self.args.paper else self.task.WEIGHTS
        total = sum(weights[name] * value for name, value in terms.items())
        self.optimiser.zero_grad(set_to_none=True)
        total.backward()
        norm = torch.nn.utils.clip_grad_norm_(self.model.parameters(), self.task.LARGEST_GRADIENT)
        if torch.isfinite(norm):
            self.optimiser.step()
            self.average.update(self.model, self.step)
        self.step += 1
        for name, value in terms.items():
            self.mean[name] = 0.98 * self.mean.get(name, float(value)) + 0.02 * float(value)

    def save(self):
        self.averaged.load_state_dict(self.average.state)
        self.averaged.eval()
        with torch.no_grad():
            figures = self.task.validate(self.averaged, self.held_out, self.args.device)
        text = (f"{self.step} steps of {self.args.batch} scenes out of {len(self.scenes)}, "
                f"{self.elapsed / 60:.0f} minutes; validation "
                + ", ".join(f"{name} {value:.2f}" for name, value in figures.items()))
        state = {"model": self.model.state_dict(), "average": self.average.state,
                 "optimiser": self.optimiser.state_dict(), "step": self.step, "elapsed": self.elapsed,
                 "config": self.config, "summary": text, "network": self.args.network}
        torch.save(state, self.path + ".partial")
        os.replace(self.path + ".partial", self.path)
        write_safetensors(os.path.join(self.args.run, "model.safetensors"),
                          *self.task.export(self.averaged, np.float16, text))
        if self.log.tell() == 0:
            self.table.writerow(["step", "seconds", *self.mean, *figures])
        self.table.writerow([self.step, f"{self.elapsed:.0f}", *(f"{v:.5f}" for v in self.mean.values()),
                             *(f"{v:.3f}" for v in figures.values())])
        self.log.flush()
        print(f"\n{text}", file=sys.stderr, flush=True)

    def run(self):
        limit, now = self.args.minutes * 60, time.monotonic()
        last_step = self.args.steps or float("inf")
        next_save = self.elapsed + SAVE_SECONDS
        self.model.train()
        while self.elapsed < limit and self.step < last_step:
            progress = self.step / last_step if self.args.steps else self.elapsed / limit
            self.advance(progress)
            before, now = now, time.monotonic()
            self.elapsed += now - before if now - before < PAUSE_SECONDS else 0
            if self.step % 10 == 0:
                print(f"\rstep {self.step}, {self.elapsed / 60:.1f}/{self.args.minutes:g} min, "
                      + ", ".join(f"{k} {v:.4f}" for k, v in self.mean.items()) + "  ",
                      end="", file=sys.stderr, flush=True)
            if self.elapsed >= next_save and self.elapsed < limit:
                self.save()
                self.scenes = Shards(self.args.cache)   # packing may go on beside the training
                next_save, now = self.elapsed + SAVE_SECONDS, time.monotonic()
        self.save()
