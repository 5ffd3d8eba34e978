"""What the fusion network is trained on and for; see training.py."""
import numpy as np
import torch
import torch.nn.functional as F

from fusion import ANCHORS, Fusion
from training import psnr

WEIGHTS = {"frames": 10.0, "log": 0.3, "mean": 250.0, "structure": 2.0}
LARGEST_GRADIENT = 2.0
SIZES = {"tiny": ((8, 16, 32, 48), (4, 8, 16)), "small": ((16, 32, 64, 96), (8, 16, 32)),
         "base": ((32, 64, 96, 128), (16, 32, 48))}
FRAMES = 2      # of a scene's random times, a step
SATURATED = 0.97    # blurry values from here on may be less than the mean
STRIDE = 3      # of the loss's windows of SSIM: every one of them would double the time of a step


def config(args):
    trunk, head = SIZES[args.size]
    return {"trunk": trunk, "head": head}


def build(settings):
    return Fusion(**settings)


def augment(scene, rng):
    """Mirrors, transposes and reverses time (order turned round, polarities and signs swapped)."""
    scene = dict(scene)
    if rng.random() < 0.5:      # backwards
        for name in ("anchors", "prior", "truth", "counts", "times", "moved"):
            scene[name] = scene[name].flip(0)
        scene["times"], scene["moved"] = -scene["times"], -scene["moved"]
        # Step back over an event: the one before becomes the one after, with the other sign.
        scene["surfaces"] = -scene["surfaces"].flip(0)[:, [2, 3, 0, 1]]
        scene["thresholds"] = scene["thresholds"].flip(0)
    for axis in (0, 1):         # x, y
        if rng.random() < 0.5:
            for name, value in scene.items():
                if value.dim() >= 3:
                    scene[name] = value.flip(value.dim() - 1 - axis)
            sign = torch.ones(2, dtype=scene["moved"].dtype)
            sign[axis] = -1
            scene["moved"] = scene["moved"] * sign.view(2, 1, 1)
    height, width = scene["blurry"].shape[-2:]
    if rng.random() < 0.5 and height == width:
        for name, value in scene.items():
            if value.dim() >= 3:
                scene[name] = value.transpose(-1, -2)
        scene["moved"] = scene["moved"].flip(1)
    return scene


def stack(scenes, device, frames=None):
    """A batch of float32 tensors from scenes; frames: indices of the times to keep, a list a scene."""
    out = {}
    for name in scenes[0]:
        values = [scene[name] for scene in scenes]
        if frames is not None and name in ("prior", "surfaces", "truth", "times"):
            values = [value[list(keep)] for value, keep in zip(values, frames)]
        out[name] = torch.stack(values).to(device).float()
    out["blurry"] /= 255
    out["truth"] /= 255
    out["surfaces"] /= 127
    thresholds = out["thresholds"].view(-1, 1, 2, 1, 1)
    size = torch.where(out["surfaces"] > 0, thresholds[:, :, :1], thresholds[:, :, 1:])
    out["surfaces"] = out["surfaces"] * size
    return out


def batch(scenes, rng, device):
    scenes = [augment(scene, rng) for scene in scenes]
    if len(scenes[0]["times"]) == ANCHORS:      # of pack.py --even
        return stack(scenes, device)
    frames = [rng.choice(len(scene["times"]), FRAMES, replace=False) for scene in scenes]
    return stack(scenes, device, frames)


def forward(model, b, mixed=False):
    exposure = (b["anchors"], b["blurry"], b["counts"], b["moved"])
    return model(exposure, b["prior"], b["surfaces"], b["times"], mixed)


def similarity(a, b, stride=1):
    """Mean SSIM of frames N x T x H x W in [0, 1], windows of 7x7 pixels inside the frames (skimage's defaults)."""
    def mean(x):
        return F.avg_pool2d(x, 7, stride)

    def covariance(x, mean_x, y, mean_y):
        return 49 / 48 * (mean(x * y) - mean_x * mean_y)    # unbiased
    mean_a, mean_b = mean(a), mean(b)
    small, steady = 0.01 ** 2, 0.03 ** 2
    structure = (2 * covariance(a, mean_a, b, mean_b) + steady) / (
        covariance(a, mean_a, a, mean_a) + covariance(b, mean_b, b, mean_b) + steady)
    return ((2 * mean_a * mean_b + small) / (mean_a ** 2 + mean_b ** 2 + small) * structure).mean()


def losses(model, b, rng, progress, mixed):
    frames, truth = forward(model, b, mixed), b["truth"]
    terms = {"frames": torch.sqrt((frames - truth).square() + 1e-6).mean(),
             "log": torch.log((frames - truth).square().mean((2, 3)) + 1e-5).mean(),
             "structure": 1 - similarity(frames, truth, STRIDE)}
    if truth.shape[1] == ANCHORS:
        # The prior's mean over the exposure is the blurry frame: so must be that of what corrects it.
        change = frames - b["prior"]
        mean = (change.sum(1) - 0.5 * (change[:, 0] + change[:, -1])) / (ANCHORS - 1)
        seen = b["blurry"][:, 0] < SATURATED
        terms["mean"] = (seen * torch.sqrt(mean.square() + 1e-7)).mean()
    return terms


def validate(model, scenes, device, count=40):
    """Mean PSNR (dB) of the blurry frame, the prior and the result at the scenes' random times; the result's SSIM."""
    figures = []
    for i in range(min(count, len(scenes))):
        b = stack([scenes.scene(i)], device)
        frames = forward(model, b)
        figures.append([psnr(f, b["truth"]) for f in (b["blurry"].expand_as(frames), b["prior"], frames)]
                       + [float(similarity(frames.clamp(0, 1), b["truth"]))])
    return dict(zip(("blurry", "prior", "fused", "SSIM"), np.mean(figures, 0)))


def export(model, dtype, text):
    """Tensors and metadata of the exported file."""
    tensors = {"fusion." + name: value.detach().cpu().numpy().astype(dtype)
               for name, value in model.state_dict().items()}
    trunk, head = model.widths
    return tensors, {"model": "fusion", "trunk": " ".join(map(str, trunk)), "head": " ".join(map(str, head)),
                     "training": text}
