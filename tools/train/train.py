#!/usr/bin/env python3
"""Trains the U-Net and the refinement end to end on packed scenes, for a given time, resumably."""
import argparse
import csv
import os
import sys
import time

import numpy as np
import torch

from export import model_metadata, model_tensors, write_safetensors
from model import PAPER, ECIR, chebyshev_nodes, derivative_at_nodes, frame_matrix, render
from simulate import BINS, KEYPOINTS, UNIFORM_TIMES

ARRAYS = ("blurry", "histogram", "between", "keypoints", "truth", "derivative", "times")
REFINE_COST = 6 * 64 * 64   # frames x pixels of a refinement step, held about constant
RHO = 5.0                   # of the residual loss
# Weights: the paper's 1, 10, 10, 0.5 for derivative, primitive, refined frames and residuals, with
# the derivative's lowered (keypoints close together make it blind to the error of the frames) and
# a term on the logarithm of each frame's mean square error, because PSNR is a mean over frames.
WEIGHTS = {"derivative": 0.1, "primitive": 10.0, "refined": 10.0, "residual": 0.5, "log": 0.3}


class Scenes:
    """Random augmented batches from a folder that simulate.py packed."""

    def __init__(self, folder):
        try:
            self.arrays = {name: np.load(os.path.join(folder, name + ".npy"), mmap_mode="r")
                           for name in ARRAYS}
        except (OSError, ValueError) as error:
            sys.exit(f"train: '{folder}' holds no complete scenes ({error}); run simulate.py --cache first")

    def __len__(self):
        return len(self.arrays["blurry"])

    def batch(self, index, rng=None):
        """float32 tensors for the scenes of index; flipped and reversed at random with an rng."""
        items = []
        for i in index:
            item = {name: torch.from_numpy(array[i].copy()) for name, array in self.arrays.items()}
            items.append(augment(item, rng) if rng is not None else item)
        out = {name: torch.stack([item[name] for item in items]).float() for name in ARRAYS}
        out["blurry"] /= 255
        out["truth"] /= 255
        out["keypoints"] /= 32767
        return out


def augment(item, rng):
    """Mirrors, transposes and reverses time (order turned round, polarity swapped, slopes negated)."""
    axes = [axis for axis in (1, 2) if rng.random() < 0.5]
    swap, backwards = rng.random() < 0.5, rng.random() < 0.5
    out = {}
    for name, value in item.items():
        picture = value.dim() == 3
        # Reversing a histogram's channels turns the interval order and the two polarities at once.
        turned = (axes if picture else []) + ([0] if backwards else [])
        value = value.flip(turned) if turned else value
        value = value.transpose(1, 2) if picture and swap else value
        if backwards and name in ("keypoints", "derivative", "times"):
            value = -value
        out[name] = value
    return out


def choose_frames(times, rng):
    """Indices [N, d] of ascending frame times for the refinement and d: runs of the evenly spaced
    ones, or any; d from 2 to all evenly spaced ones."""
    d = int(rng.integers(2, UNIFORM_TIMES + 1))
    even = np.linspace(-1, 1, UNIFORM_TIMES)
    chosen = []
    for row in times:
        if rng.random() < 0.6:
            candidates = np.array([int(np.argmin(np.abs(row - u))) for u in even])
            first = rng.integers(0, UNIFORM_TIMES - d + 1)
            chosen.append(candidates[first:first + d])
        else:
            chosen.append(np.sort(rng.choice(len(row), d, replace=False)))
    return np.stack(chosen), d


def refinement_window(side, d, rng):
    """Slices of a random crop whose cost is about constant, and those of its inside, in the crop.

    The inside leaves out pixels that see the crop's own border, but keeps the picture's.
    """
    extent = min(side, int(np.sqrt(REFINE_COST / d)) // 8 * 8)
    crop, inside = [], []
    for _ in range(2):
        start = int(np.clip(rng.integers(-24, side - extent + 25), 0, side - extent))
        crop.append(slice(start, start + extent))
        inside.append(slice(0 if start == 0 else 4, extent if start + extent == side else extent - 4))
    return tuple(crop), tuple(inside)


def gather(frames, index):
    """frames N x T x H x W at index [N, d]."""
    return torch.stack([frames[i][list(index[i])] for i in range(len(index))])


def interval_counts(between, index):
    """Counts N x 2(d-1) x H x W between the chosen times, from those between all T times."""
    out = []
    for counts, chosen in zip(between, index):
        pairs = counts.unflatten(0, (-1, 2))
        out.append(torch.cat([pairs[a:b].sum(0) for a, b in zip(chosen[:-1], chosen[1:])]))
    return torch.stack(out)


def log_error(frames, truth):
    return torch.log((frames - truth).square().mean((2, 3)) + 1e-5).mean()


def losses(model, batch, rng, refine, mixed=False):
    """The training objective's terms (section 4.3), unweighted; refine adds the second stage.

    mixed: convolutions in bfloat16, everything else in float32.
    """
    precision = torch.autocast(batch["blurry"].device.type, torch.bfloat16, enabled=mixed)
    with precision:
        derivative = model.unet(batch["blurry"], batch["histogram"], batch["keypoints"])
    values = derivative_at_nodes(derivative, batch["keypoints"], model.variant, chebyshev_nodes(model.n))
    times = batch["times"].numpy()
    matrix = np.stack([frame_matrix(row, model.n) for row in times])
    frames, truth = render(batch["blurry"], values, matrix), batch["truth"]
    terms = {"derivative": (derivative - batch["derivative"]).abs().mean(),
             "primitive": (frames - truth).abs().mean(), "log": log_error(frames, truth)}
    if not refine:
        return terms
    index, d = choose_frames(times, rng)
    (rows, columns), inside = refinement_window(truth.shape[-1], d, rng)
    cut = (slice(None), slice(None), rows, columns)
    keep = (slice(None), slice(None)) + inside
    target = gather(truth[cut], index)
    initial, counts = gather(frames[cut], index), interval_counts(batch["between"][cut], index)
    with precision:
        refined, residuals = model.refine(initial, counts)
    refined, target = refined[keep], target[keep]
    step = target[:, 1:] - target[:, :-1]
    weight = torch.exp(RHO * step.abs())
    terms["refined"] = (refined - target).abs().mean()
    terms["residual"] = sum((weight * (r[keep] - step).abs()).mean() for r in residuals) * (d - 1) / len(residuals)
    terms["log"] = terms["log"] + log_error(refined, target)
    return terms


def to_device(batch, device):
    """The batch's tensors on a device; times stay where NumPy can read them."""
    return {name: value if name == "times" else value.to(device) for name, value in batch.items()}


def validate(model, scenes, count=12):
    """Mean PSNR (dB) of the blurry, the initial and the refined frames at 14 times."""
    even = np.linspace(-1, 1, UNIFORM_TIMES)
    model.eval()
    result = np.zeros(3)
    with torch.no_grad():
        for i in range(min(count, len(scenes))):
            b = to_device(scenes.batch([i]), next(model.parameters()).device)
            index = np.array([[int(np.argmin(np.abs(b["times"][0].numpy() - u))) for u in even]])
            truth = gather(b["truth"], index)
            initial, refined = model(b["blurry"], b["histogram"], b["keypoints"], even,
                                     interval_counts(b["between"], index))
            for k, frames in enumerate((b["blurry"].expand_as(truth), initial, refined)):
                error = (frames.clamp(0, 1) - truth).square().mean((2, 3))
                result[k] += float(-10 * torch.log10(error + 1e-8).mean())
    model.train()
    return result / min(count, len(scenes))


def restore(state):
    """ECIR module of a checkpoint, in evaluation mode."""
    model = ECIR(**state["config"])
    model.load_state_dict(state["model"])
    return model.eval()


def start_refinement(model):
    """An initial guess near 'keep the frames', so that early training is about the residuals."""
    with torch.no_grad():
        model.refine.alpha_net.bias.fill_(1.5)
        polish = model.refine.final
        polish[0].weight.mul_(0.2)
        polish[0].weight[:16, 0, 1, 1] += 1.0
        polish[2].weight.mul_(0.1)
        polish[2].weight[0, :16, 1, 1] += 1.0 / 16
        model.unet.pred.weight.mul_(0.2)
        for module in model.modules():
            if isinstance(module, torch.nn.BatchNorm2d):
                module.momentum = 0.02   # small batches: average the statistics for longer


def learning_rate(args, progress):
    """Linear warm-up over 1 %, then a half cosine down to 1 % of the peak."""
    warm = min(1.0, 0.02 + progress / 0.01)
    return args.rate * warm * (0.01 + 0.99 * 0.5 * (1 + np.cos(np.pi * min(progress, 1.0))))


def summary(steps, minutes, scenes, batch, psnr):
    return (f"{steps} steps of {batch} scenes out of {scenes}, {minutes:.0f} minutes; "
            f"validation PSNR blurry {psnr[0]:.2f}, initial {psnr[1]:.2f}, refined {psnr[2]:.2f} dB")


def parse():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cache", required=True, help="training scenes of simulate.py")
    parser.add_argument("--validation", required=True, help="validation scenes of simulate.py")
    parser.add_argument("--run", required=True, help="folder for checkpoint.pt, log.csv, model.safetensors")
    parser.add_argument("--minutes", type=float, default=60, help="whole training time, resumed runs included")
    parser.add_argument("--width", type=int, default=32)
    parser.add_argument("--batch", type=int, default=4)
    parser.add_argument("--rate", type=float, default=1e-3, help="peak learning rate of Adam")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--bfloat16", action="store_true",
                        help="convolutions in bfloat16: twice as fast on a CPU with AMX or AVX512-BF16")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu",
                        help="where to train; checkpoints go on from one to the other")
    parser.add_argument("--resume", action="store_true", help="go on from the folder's checkpoint.pt")
    args = parser.parse_args()
    if args.minutes <= 0 or args.batch < 2 or args.rate <= 0:
        parser.error("--minutes and --rate must be positive, --batch at least 2")
    return args


def main():
    args = parse()
    torch.manual_seed(args.seed)
    torch.set_num_threads(int(os.environ.get("OMP_NUM_THREADS", torch.get_num_threads())))
    scenes, held_out = Scenes(args.cache), Scenes(args.validation)
    os.makedirs(args.run, exist_ok=True)
    path = os.path.join(args.run, "checkpoint.pt")
    if not args.resume and os.path.exists(path):
        sys.exit(f"train: {path} exists; add --resume to go on, or choose another --run folder")
    config = dict(variant=PAPER, width=args.width, bins=BINS, n=KEYPOINTS, iterations=3)
    step, elapsed = 0, 0.0
    model = ECIR(**config).to(args.device, memory_format=torch.channels_last)
    start_refinement(model)
    optimiser = torch.optim.Adam(model.parameters(), args.rate)
    if args.resume:
        try:
            state = torch.load(path, map_location=args.device)
        except OSError as error:
            sys.exit(f"train: cannot resume from {path}: {error.strerror}")
        model.load_state_dict(state["model"])
        optimiser.load_state_dict(state["optimiser"])
        step, elapsed, config = state["step"], state["elapsed"], state["config"]
    model.train()
    limit, begin, mean = args.minutes * 60, time.monotonic() - elapsed, {}
    next_save = elapsed + 360
    log = open(os.path.join(args.run, "log.csv"), "a" if args.resume else "w", newline="")
    table = csv.writer(log)
    if not args.resume:
        table.writerow(["step", "seconds", "derivative", "primitive", "refined", "residual",
                        "psnr_blurry", "psnr_initial", "psnr_refined"])

    def save():
        psnr = validate(model, held_out)
        text = summary(step, elapsed / 60, len(scenes), args.batch, psnr)
        state = {"model": model.state_dict(), "optimiser": optimiser.state_dict(), "step": step,
                 "elapsed": elapsed, "config": config, "summary": text}
        torch.save(state, path + ".partial")
        os.replace(path + ".partial", path)
        write_safetensors(os.path.join(args.run, "model.safetensors"), model_tensors(model, np.float16),
                          model_metadata(model, training=text))
        table.writerow([step, f"{elapsed:.0f}"] + [f"{mean.get(k, float('nan')):.5f}" for k in
                       ("derivative", "primitive", "refined", "residual")] + [f"{v:.3f}" for v in psnr])
        log.flush()
        print(f"\n{text}", file=sys.stderr, flush=True)

    while elapsed < limit:
        progress = elapsed / limit
        for group in optimiser.param_groups:
            group["lr"] = learning_rate(args, progress)
        rng = np.random.default_rng([args.seed, step])
        batch = to_device(scenes.batch(rng.integers(0, len(scenes), args.batch), rng), args.device)
        # The refinement's steps cost as much as the U-Net's: it joins late and then always runs.
        refine = progress > 0.6 or (progress > 0.08 and step % 3 == 0)
        # The last tenth settles in the precision of inference.
        terms = losses(model, batch, rng, refine, args.bfloat16 and progress < 0.9)
        total = sum(WEIGHTS[name] * value for name, value in terms.items())
        optimiser.zero_grad(set_to_none=True)
        total.backward()
        norm = torch.nn.utils.clip_grad_norm_(model.parameters(), 2.0)
        if torch.isfinite(norm):
            optimiser.step()
        for name, value in terms.items():
            mean[name] = 0.98 * mean.get(name, float(value)) + 0.02 * float(value)
        step, elapsed = step + 1, time.monotonic() - begin
        if step % 10 == 0:
            print(f"\rstep {step}, {elapsed / 60:.1f}/{args.minutes:g} min, "
                  + ", ".join(f"{k} {v:.4f}" for k, v in mean.items()) + "  ", end="", file=sys.stderr, flush=True)
        if elapsed >= next_save and elapsed < limit:
            save()
            next_save = elapsed + 360
            elapsed = time.monotonic() - begin
    save()


if __name__ == "__main__":
    main()
