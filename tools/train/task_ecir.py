"""What the E-CIR network is trained on and for (section 4.3 of the paper); see training.py."""
import numpy as np
import torch

from export import model_metadata, model_tensors
from model import PAPER, ECIR, chebyshev_nodes, derivative_at_nodes, frame_matrix, pivots, render
from pack import BINS, KEYPOINTS
from simulate import UNIFORM_TIMES
from training import psnr

REFINE_COST = 6 * 64 * 64   # frames x pixels of a refinement step, held about constant
RHO = 5.0                   # of the residual loss
LARGEST_GRADIENT = 2.0
# The paper's weights for derivative, primitive, refined frames and residuals.
PAPER_WEIGHTS = {"derivative": 1.0, "primitive": 10.0, "refined": 10.0, "residual": 0.5, "log": 0.0}
# With the derivative's lowered (keypoints close together make it blind to the error of the frames)
# and a term on the logarithm of each frame's mean square error, because PSNR is a mean over frames.
WEIGHTS = {"derivative": 0.1, "primitive": 10.0, "refined": 10.0, "residual": 0.5, "log": 0.3}
EVEN = np.linspace(-1, 1, UNIFORM_TIMES)


class FrameUNet(ECIR):
    """The ablation's frame-based output: the U-Net's last layer gives the 14 even frames themselves."""

    def __init__(self, **config):
        super().__init__(**config)
        self.unet.pred = torch.nn.Conv2d(self.unet.pred.in_channels, UNIFORM_TIMES, 1)


def config(args):
    return dict(variant=PAPER, width=args.width, bins=BINS, n=KEYPOINTS, iterations=3,
                inputs=args.inputs, output=args.output, refined=args.refined)


def build(settings):
    network = {k: v for k, v in settings.items() if k not in ("inputs", "output", "refined")}
    model = (FrameUNet if settings.get("output") == "frames" else ECIR)(**network)
    model.inputs, model.output = settings.get("inputs", "both"), settings.get("output", "curve")
    model.refined = settings.get("refined", True)
    start_refinement(model)
    return model


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


def augment(scene, rng):
    """Mirrors, transposes and reverses time (order turned round, polarity swapped, slopes negated)."""
    axes = [axis for axis in (1, 2) if rng.random() < 0.5]
    height, width = scene["blurry"].shape[-2:]
    swap, backwards = rng.random() < 0.5 and height == width, rng.random() < 0.5
    out = {}
    for name, value in scene.items():
        picture = value.dim() == 3
        # Reversing a histogram's channels turns the interval order and the two polarities at once.
        turned = (axes if picture else []) + ([0] if backwards else [])
        value = value.flip(turned) if turned else value
        value = value.transpose(1, 2) if picture and swap else value
        if backwards and name in ("keypoints", "derivative", "times"):
            value = -value
        out[name] = value
    return out


def stack(scenes, device):
    out = {name: torch.stack([scene[name] for scene in scenes]).float() for name in scenes[0]}
    out["blurry"] /= 255
    out["truth"] /= 255
    out["keypoints"] /= 32767
    # Times stay where NumPy can read them.
    return {name: value if name == "times" else value.to(device) for name, value in out.items()}


def batch(scenes, rng, device):
    return stack([augment(scene, rng) for scene in scenes], device)


def choose_frames(times, rng):
    """Indices [N, d] of ascending frame times for the refinement and d: runs of the evenly spaced
    ones, or any; d from 2 to all evenly spaced ones."""
    d = int(rng.integers(2, UNIFORM_TIMES + 1))
    chosen = []
    for row in times:
        if rng.random() < 0.6:
            first = rng.integers(0, UNIFORM_TIMES - d + 1)
            chosen.append(even_index(row)[first:first + d])
        else:
            chosen.append(np.sort(rng.choice(len(row), d, replace=False)))
    return np.stack(chosen), d


def even_index(times):
    """Indices of the 14 even times among a scene's."""
    return np.array([int(np.argmin(np.abs(times - u))) for u in EVEN])


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


def seen(model, b):
    """The U-Net's inputs; those that an ablation hides are zero, keypoints their pivots."""
    blurry, counts, keypoints = b["blurry"], b["histogram"], b["keypoints"]
    if model.inputs == "events":
        blurry = torch.zeros_like(blurry)
    elif model.inputs == "frame":
        counts = torch.zeros_like(counts)
        even = torch.as_tensor(pivots(model.n), dtype=keypoints.dtype, device=keypoints.device)
        keypoints = even.view(1, -1, 1, 1).expand_as(keypoints)
    return blurry, counts, keypoints


def initial_frames(model, b, precision):
    """The U-Net's output and the frames at all of the batch's times (frame-based: at the even ones)."""
    blurry, counts, keypoints = seen(model, b)
    with precision:
        derivative = model.unet(blurry, counts, keypoints)
    if model.output == "frames":
        return derivative, derivative + b["blurry"]
    values = derivative_at_nodes(derivative, keypoints, model.variant, chebyshev_nodes(model.n))
    matrix = np.stack([frame_matrix(row, model.n) for row in b["times"].numpy()])
    return derivative, render(b["blurry"], values, matrix)


def log_error(frames, truth):
    return torch.log((frames - truth).square().mean((2, 3)) + 1e-5).mean()


def losses(model, b, rng, progress, mixed):
    """The training objective's terms, unweighted. mixed: convolutions in bfloat16."""
    # The refinement's steps cost as much as the U-Net's: it joins late and then always runs.
    step = int(rng.integers(0, 3))
    refine = model.refined and (progress > 0.6 or (progress > 0.08 and step == 0))
    precision = torch.autocast(b["blurry"].device.type, torch.bfloat16, enabled=mixed)
    derivative, frames = initial_frames(model, b, precision)
    times, truth = b["times"].numpy(), b["truth"]
    if model.output == "frames":
        truth = gather(truth, [even_index(row) for row in times])
        return {"primitive": (frames - truth).abs().mean(), "log": log_error(frames, truth)}
    terms = {"primitive": (frames - truth).abs().mean(), "log": log_error(frames, truth)}
    if model.inputs != "frame":     # the packed derivative is that at the events' keypoints
        terms["derivative"] = (derivative - b["derivative"]).abs().mean()
    if not refine:
        return terms
    index, d = choose_frames(times, rng)
    (rows, columns), inside = refinement_window(truth.shape[-1], d, rng)
    cut = (slice(None), slice(None), rows, columns)
    keep = (slice(None), slice(None)) + inside
    target = gather(truth[cut], index)
    with precision:
        refined, residuals = model.refine(gather(frames[cut], index), interval_counts(b["between"][cut], index))
    refined, target = refined[keep], target[keep]
    step = target[:, 1:] - target[:, :-1]
    weight = torch.exp(RHO * step.abs())
    terms["refined"] = (refined - target).abs().mean()
    terms["residual"] = sum((weight * (r[keep] - step).abs()).mean() for r in residuals) * (d - 1) / len(residuals)
    terms["log"] = terms["log"] + log_error(refined, target)
    return terms


def validate(model, scenes, device, count=12):
    """Mean PSNR (dB) of the blurry, the initial and the refined frames at 14 times."""
    figures = []
    for i in range(min(count, len(scenes))):
        b = stack([scenes.scene(i)], device)
        index = [even_index(b["times"][0].numpy())]
        truth = gather(b["truth"], index)
        _, frames = initial_frames(model, b, torch.autocast("cpu", enabled=False))
        initial = frames if model.output == "frames" else gather(frames, index)
        refined = model.refine(initial, interval_counts(b["between"], index))[0] if model.refined else initial
        figures.append([psnr(f, truth) for f in (b["blurry"].expand_as(truth), initial, refined)])
    return dict(zip(("blurry", "initial", "refined"), np.mean(figures, 0)))


def export(model, dtype, text):
    """Tensors and metadata of the exported file."""
    return model_tensors(model, dtype), model_metadata(model, training=text)
