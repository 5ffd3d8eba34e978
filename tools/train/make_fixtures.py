#!/usr/bin/env python3
"""Reference cases for the other implementations: random small networks, inputs, float64 outputs.

Each file holds the weights under their contract names (float16, so exact in any precision),
`input.*` and `output.*`. Frames and keypoints are kept at every STRIDE-th pixel in x and y.
"""
import argparse
import os
import sys

import numpy as np
import torch

import motion
from esl_net import BINS, EslNet, export_esl_net, outward_counts
from events import network_inputs, normalise
from export import model_metadata, model_tensors, write_safetensors
from fusion import REFERENCES, Fusion, agree
from model import PAPER, RELEASE, ECIR
from prior import Prior
from scenes import Photos
from simulate import make_scene
from task_fusion import export as export_fusion

STRIDE = 5
EXPOSURE_US = 120000
FRAMES = 14
WIDTH = 4


def synthetic_blurry(rng, height, width):
    """Smooth blobs, edges and texture as whole 8-bit codes, float64 [H, W] of k / 255."""
    y, x = np.mgrid[0:height, 0:width]
    image = 0.45 + 0.2 * np.sin(x / 17.0) * np.cos(y / 11.0) + 0.1 * np.sin((x + 2 * y) / 3.1)
    image += np.where((x - 0.6 * width) ** 2 + (y - 0.4 * height) ** 2 < (0.2 * height) ** 2, 0.25, 0.0)
    image += rng.normal(0, 0.02, image.shape)
    return np.round(np.clip(image, 0, 1) * 255) / 255


def synthetic_events(rng, height, width, count):
    """Sorted t, x, y, p: sweeping edges with bursts per pixel, shared microseconds, bin edges."""
    centres = count // 6
    t0 = rng.integers(0, EXPOSURE_US + 1, centres)
    x0 = np.clip(width * t0 / EXPOSURE_US + rng.normal(0, width / 12, centres), 0, width - 1)
    y0 = np.clip(height * (0.5 + 0.35 * np.sin(t0 / 9000.0)) + rng.normal(0, height / 9, centres),
                 0, height - 1)
    burst = 5
    t = (t0[:, None] + np.cumsum(rng.integers(0, 2500, (centres, burst)), 1)).ravel()
    x, y = np.repeat(x0.astype(np.int64), burst), np.repeat(y0.astype(np.int64), burst)
    p = np.repeat(rng.integers(0, 2, centres), burst)
    p = np.where(rng.random(p.size) < 0.15, 1 - p, p)

    edges = np.concatenate([np.arange(21) * 6000, (2 * np.arange(9) + 1) * EXPOSURE_US // 18,
                            [0, EXPOSURE_US]])
    special = np.repeat(edges, 8)
    special = np.concatenate([special, rng.integers(1, 9, 80) * EXPOSURE_US // 10,
                              np.full(40, EXPOSURE_US // 2)])
    t = np.concatenate([t, special])
    x = np.concatenate([x, rng.integers(0, width // STRIDE, special.size) * STRIDE])
    y = np.concatenate([y, rng.integers(0, height // STRIDE, special.size) * STRIDE])
    p = np.concatenate([p, rng.integers(0, 2, special.size)])
    # Two events of one pixel at the same distance on either side of the pivot 120000 * 3 / 9.
    for i, offset in enumerate((3, 700, 6000)):
        t = np.append(t, [40000 - offset, 40000 + offset])
        x, y, p = np.append(x, [5 * i, 5 * i]), np.append(y, [10, 10]), np.append(p, [1, 0])
    order = np.argsort(t, kind="stable")
    order = order[t[order] <= EXPOSURE_US]
    return t[order].astype(np.int64), x[order], y[order], p[order]


def scaled_network(rng, variant, bins, inputs, width=WIDTH, iterations=3):
    """Random network (half-precision weights) whose frames vary visibly and stay of order one."""
    torch.manual_seed(int(rng.integers(1 << 31)))
    model = ECIR(variant, width, bins, iterations=iterations).double().eval()
    blurry, counts, points, times, between = inputs
    with torch.no_grad():
        for module in model.modules():
            if isinstance(module, torch.nn.BatchNorm2d):
                module.running_mean.normal_(0, 0.2)
                module.running_var.uniform_(0.5, 1.5)
                module.weight.uniform_(0.6, 1.4)
                module.bias.normal_(0, 0.2)
        for name in ("de_conv1", "de_conv2", "de_conv3", "de_conv4"):
            getattr(model.unet, name)[0].weight.mul_(2.0)
        spread = model.unet(blurry, counts, points).std()
        model.unet.pred.weight.mul_(0.3 / spread)
        model.unet.pred.bias.zero_()
        model.refine.alpha_net.bias.fill_(1.5)
        for net in (model.refine.first_res_net, model.refine.other_res_net):
            net[2].weight.mul_(0.8)
        # A near identity with some character: the polish alone must not hide the frames.
        polish = model.refine.final
        polish[0].weight.mul_(0.3)
        polish[0].weight[:, 0, 1, 1] += 1.0
        polish[2].weight.mul_(0.1)
        polish[2].weight[0, :, 1, 1] += 1.0 / 32
        for value in model.state_dict().values():
            if value.is_floating_point():
                value.copy_(value.half().double())
    return model


def write_case(path, variant, width, height, count, seed):
    """Writes one case; returns the median frame change by the curve and by the refinement."""
    rng = np.random.default_rng(seed)
    bins = 40 if variant == PAPER else 26
    blurry = synthetic_blurry(rng, height, width).astype(np.float32)
    t, x, y, p = synthetic_events(rng, height, width, count)
    times = np.linspace(-1, 1, FRAMES).astype(np.float32)
    counts, points, between = network_inputs(t, x, y, p, 0, EXPOSURE_US, (height, width), variant,
                                             bins, 10, times.astype(np.float64))
    inputs = [torch.from_numpy(np.asarray(a)).double()[None]
              for a in (blurry[None], counts, points, times, between)]
    model = scaled_network(rng, variant, bins, inputs)
    with torch.no_grad():
        initial, refined = model(inputs[0], inputs[1], inputs[2], times.astype(np.float64), inputs[4])
    initial, refined = initial[0].numpy(), refined[0].numpy()
    tensors = model_tensors(model, np.float16)
    small = {"input.blurry": blurry, "input.t": t, "input.x": x, "input.y": y, "input.p": p,
             "input.exposure": np.array([0, EXPOSURE_US]), "input.times": times,
             "output.initial": initial[:, ::STRIDE, ::STRIDE],
             "output.refined": refined[:, ::STRIDE, ::STRIDE],
             "output.histogram_sum": counts.sum((1, 2), dtype=np.float64),
             "output.keypoints": points[:, ::STRIDE, ::STRIDE]}
    tensors.update({name: np.asarray(value, np.float32) for name, value in small.items()})
    for name in ("input.x", "input.y", "input.p"):  # whole numbers below 2048: exact, and smaller
        tensors[name] = tensors[name].astype(np.float16)
    write_safetensors(path, tensors, model_metadata(model, training="none: random reference case"))
    return np.abs(initial - blurry).mean(), np.abs(refined - initial).mean(), np.abs(refined).max()


def scaled_esl_net(rng, blurry, counts):
    """Random eSL-Net (half-precision weights) whose rounds converge and whose frames are of order one."""
    torch.manual_seed(int(rng.integers(1 << 31)))
    net = EslNet().double().eval()
    layer = net.scn[0]
    with torch.no_grad():
        for conv in (net.event_c1, net.event_c2):
            conv.weight.mul_(4.0)
        # S2 the transpose of S1, of norm 1: the rounds are gradient steps that cannot diverge.
        code = torch.ones(1, 128, *blurry.shape[2:], dtype=torch.float64)
        layer.S2.weight.copy_(layer.S1.weight.transpose(0, 1).flip(2, 3))
        for _ in range(30):
            code = layer.S2(layer.S1(code / code.norm()))
        for conv in (layer.S1, layer.S2):
            conv.weight.div_(code.norm().sqrt())
        net.endconv.weight.div_(2 * net(blurry, counts).std())
        for value in net.parameters():
            value.copy_(value.half().double())
    return net


def write_esl_case(path, width, height, count, seed):
    """Writes one case of eSL-Net, every pixel of it; returns the frames' spread and largest value."""
    rng = np.random.default_rng(seed)
    blurry = synthetic_blurry(rng, height, width).astype(np.float32)
    t, x, y, p = synthetic_events(rng, height, width, count)
    times = np.linspace(-1, 1, 4)
    instants = np.arange(4) * EXPOSURE_US // 3
    edges = (instants[:, None] + np.arange(-BINS, BINS + 1) * EXPOSURE_US // BINS).ravel()
    edges = edges[(edges >= 0) & (edges <= EXPOSURE_US)]
    t, x, y, p = (np.concatenate([a, b]) for a, b in zip((t, x, y, p), (
        edges, rng.integers(0, width, edges.size), rng.integers(0, height, edges.size),
        rng.integers(0, 2, edges.size))))
    order = np.argsort(t, kind="stable")
    t, x, y, p = t[order], x[order], y[order], p[order]
    counts = np.stack([outward_counts(t, x, y, p, 0, EXPOSURE_US, time, (height, width)) for time in times])
    image = torch.from_numpy(blurry).double()[None, None] * 255
    gates = torch.from_numpy(counts).double()
    net = scaled_esl_net(rng, torch.from_numpy(blurry).double()[None, None], gates[:1])
    with torch.no_grad():
        frames = torch.cat([net(image, one[None])[0] for one in gates]).numpy() / 255
    more = {"input.blurry": blurry, "input.t": t, "input.x": x, "input.y": y, "input.p": p,
            "input.exposure": np.array([0, EXPOSURE_US]), "input.times": times, "output.frames": frames,
            "output.counts": counts.sum((2, 3))}
    half = ("input.x", "input.y", "input.p")
    more = {name: np.asarray(value, np.float16 if name in half else np.float32)
            for name, value in more.items()}
    export_esl_net(path, net.state_dict(), "none: random reference case", np.float16, **more)
    return np.abs(np.diff(frames, axis=0)).mean((1, 2)), np.abs(frames).max()


def fusion_inputs(blurry, t, x, y, p, times, thresholds):
    """Arguments of the fusion network's forward() for one exposure, float64."""
    prior = Prior(normalise(t, 0, EXPOSURE_US), x, y, p, blurry.shape, thresholds)
    fine = prior.frames(blurry, motion.TIMES)
    surfaces = np.stack([prior.surfaces(time) for time in times]).astype(np.float64)
    surfaces *= np.where(surfaces > 0, *thresholds)
    exposure = (fine[::motion.WINDOWS // (len(motion.ANCHORS) - 1)], blurry[None],
                np.minimum(prior.counts(motion.ANCHORS), 255), motion.estimate(fine))
    arrays = (*exposure, prior.frames(blurry, times), surfaces, np.asarray(times))
    tensors = [torch.from_numpy(np.array(a, np.float64))[None] for a in arrays]
    return tuple(tensors[:4]), *tensors[4:]


def scaled_fusion(rng, trunk, head, inputs):
    """Random fusion network (half-precision weights) whose correction is visible and of order one."""
    torch.manual_seed(int(rng.integers(1 << 31)))
    net = Fusion(trunk, head).double().eval()
    with torch.no_grad():
        for conv in net.modules():
            if isinstance(conv, (torch.nn.Conv2d, torch.nn.ConvTranspose2d)):
                conv.weight.mul_(1.8)
        net.head.out.weight.mul_(0.02 / (net(*inputs) - inputs[1]).std())
        net.head.out.bias.fill_(0.05)
        for value in net.parameters():
            value.copy_(value.half().double())
    return net


def write_fusion_case(path, width, height, trunk, head, seed):
    """Writes one case of the fusion network, every pixel of it; returns the events, the mean changes by
    the trunk, by the head and by the agreement across time, and the largest displacement."""
    rng = np.random.default_rng(seed)
    photo = Photos([synthetic_blurry(rng, 2 * height, 2 * width).astype(np.float32)])
    scene = make_scene(photo, seed, 0, (height, width), 14.0)
    blurry = (scene.blurry / 255.0).astype(np.float32)
    times = np.float32([-1, 0.3, 0.875]).astype(np.float64)     # the last is half-way between two anchors
    thresholds = np.float32([1.1 * scene.sensor.positive, 1.05 * scene.sensor.negative]).astype(np.float64)
    events = (scene.t, scene.x, scene.y, scene.p)
    inputs = fusion_inputs(blurry, *events, times, thresholds)
    net = scaled_fusion(rng, trunk, head, inputs)
    with torch.no_grad():
        frames = net(*inputs)
        references = net(*fusion_inputs(blurry, *events, motion.ANCHORS[list(REFERENCES)], thresholds))
        moved = inputs[0][3]
        agreed = agree(frames[0], references.expand(len(times), -1, -1, -1),
                       moved.expand(len(times), -1, -1, -1, -1), inputs[3][0])
        exposure = inputs[0]
        still = net((*exposure[:3], 0 * exposure[3]), *inputs[1:])
    tensors, metadata = export_fusion(net, np.float16, "none: random reference case")
    more = {"input.blurry": blurry, "input.t": scene.t, "input.x": scene.x, "input.y": scene.y,
            "input.p": scene.p, "input.exposure": np.array([0, EXPOSURE_US]), "input.times": times,
            "input.thresholds": thresholds, "output.corrected": frames[0].numpy(), "output.frames": agreed.numpy(),
            "output.moved": exposure[3][0].flatten(0, 1).numpy()}
    half = ("input.x", "input.y", "input.p")
    tensors.update({name: np.asarray(value, np.float16 if name in half else np.float32)
                    for name, value in more.items()})
    write_safetensors(path, tensors, metadata)
    return (len(scene.t), (frames - still).abs().mean(), (frames - inputs[1]).abs().mean(),
            (agreed - frames[0]).abs().mean(), moved.abs().max())


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", required=True, help="folder, for example tests/fixtures")
    parser.add_argument("--all", action="store_true",
                        help="also the release variant at 240x180 (left out by default for size)")
    args = parser.parse_args()
    if not os.path.isdir(args.output):
        sys.exit(f"make_fixtures: {args.output}: no such folder; create it first")
    cases = [(PAPER, 240, 180, 4000), (PAPER, 173, 131, 3000), (RELEASE, 173, 131, 3000)]
    cases += [(RELEASE, 240, 180, 4000)] if args.all else []
    for seed, (variant, width, height, count) in enumerate(cases):
        path = os.path.join(args.output, f"ecir-{variant}-{width}x{height}.safetensors")
        curve, refinement, peak = write_case(path, variant, width, height, count, seed + 1)
        print(f"{path}: {os.path.getsize(path)} bytes, mean change by the curve {curve:.3f}, "
              f"by the refinement {refinement:.3f}, largest value {peak:.2f}")
    path = os.path.join(args.output, "esl-net-41x29.safetensors")
    spread, peak = write_esl_case(path, 41, 29, 1500, 10)
    print(f"{path}: {os.path.getsize(path)} bytes, mean change between frames {spread.min():.3f} "
          f"to {spread.max():.3f}, largest value {peak:.2f}")
    path = os.path.join(args.output, "fusion-61x45.safetensors")
    events, moved, corrected, agreed, furthest = write_fusion_case(path, 61, 45, (16, 16, 20, 24), (12, 16, 20), 11)
    print(f"{path}: {os.path.getsize(path)} bytes, {events} events, mean change by the motion {moved:.3f}, "
          f"by the head {corrected:.3f}, by agreement {agreed:.4f}, furthest {furthest:.1f} pixels a gap")


if __name__ == "__main__":
    main()
