"""The published E-CIR network in PyTorch, in three forms that give the same frames.

published   the work that the published code does for a frame, operation by operation: NCHW, transposed
            convolutions and batch norms as layers; the curve's monomial coefficients summed over every
            combination of keypoints (n 2^(n-1) products of planes); powers of time summed over the
            coefficients; the refinement's intervals one after the other.
plain       the published layers, but the curve by divided differences and one precomputed matrix for all times:
            what can be exported (the published sums would be tens of thousands of nodes).
best        the curve as in plain, the layers arranged for speed: transposed convolutions as convolutions and a
            shuffle of pixels, the refinement's convolutions to one channel as a product of matrices and nine
            shifted sums.

All: float32, without gradients. Inputs are those of model.ECIR, histograms and keypoints made.
"""
import copy
import itertools
import warnings

import torch
import torch.nn.functional as F
from torch import nn

import paths    # noqa: F401 (before the modules of tools/train)
from model import PAPER, chebyshev_nodes, frame_matrix, spread_keypoints

STAGES = ("unet", "curve", "refine")


class PublishedUNet(nn.Module):
    """The layers of model.UNet, each run as it is declared."""

    def __init__(self, unet):
        super().__init__()
        self.layers = unet

    def forward(self, blurry, histogram, keypoints):
        net = self.layers
        inputs = torch.cat([blurry, histogram, keypoints], 1)
        half = net.en_conv1(inputs)
        quarter = net.en_conv2(half)
        eighth = net.en_conv3(quarter)
        x = net.en_conv4(eighth)
        x = F.relu(net.res1(x) + x)
        x = F.relu(net.res2(x) + x)
        x = F.relu(net.de_conv1[0](x, output_size=eighth.shape[-2:]))
        for up, skip, size in ((net.de_conv2, eighth, quarter), (net.de_conv3, quarter, half),
                               (net.de_conv4, half, inputs)):
            x = F.relu(up[0](torch.cat([x, skip], 1), output_size=size.shape[-2:]))
        return net.pred(torch.cat([x, inputs], 1))


class PublishedCurve(nn.Module):
    """Monomial coefficients of the integrated Lagrange interpolant, then its values at the times."""

    def __init__(self, times, variant):
        super().__init__()
        self.register_buffer("times", torch.as_tensor(times, dtype=torch.float32).view(1, -1, 1, 1))
        self.spread = variant == PAPER

    def forward(self, blurry, derivative, keypoints):
        if self.spread:
            keypoints = spread_keypoints(keypoints)
        count, n, height, width = keypoints.shape
        basis = keypoints.new_zeros((count, n, n, height, width))   # power of time, keypoint
        for i in range(n):
            others = [j for j in range(n) if j != i]
            scale = torch.ones_like(blurry[:, 0])
            for j in others:
                scale *= keypoints[:, i] - keypoints[:, j]
            for power in range(n):
                for chosen in itertools.combinations(others, n - 1 - power):
                    product = torch.prod(-keypoints[:, list(chosen)], dim=1)
                    basis[:, power, i] += product / (power + 1) / scale
        coefficients = (basis * derivative[:, None]).sum(2)
        even = coefficients[:, 1::2]    # of t^2, t^4, ...: the odd powers' means are 0
        divisors = torch.arange(3, n + 2, 2, device=even.device, dtype=even.dtype).view(1, -1, 1, 1)
        mean = (even / divisors).sum(1, keepdim=True)
        coefficients = torch.cat([blurry - mean, coefficients], 1)
        powers = torch.stack([self.times ** power for power in range(n + 1)], 1)
        return (coefficients.unsqueeze(2) * powers).sum(1)


class PublishedRefinement(nn.Module):
    """model.RefineNet, which goes from interval to interval and from frame to frame as the published code does."""

    def __init__(self, refine):
        super().__init__()
        self.layers = refine

    def forward(self, initial, between):
        return self.layers(initial, between)[0]


class PackedUp(nn.Module):
    """A transposed convolution of model.UNet, its weights arranged once."""

    def __init__(self, up):
        super().__init__()
        self.register_buffer("weight", up.packed_weight().detach().clone())

    def forward(self, x, size):
        return F.relu(F.pixel_shuffle(F.conv2d(x, self.weight, padding=1), 2)[..., :size[0], :size[1]])


class PackedPolish(nn.Module):
    """Two convolutions of model.RefineNet, the second, to one channel, by its nine taps: libraries have no fast
    kernel for a single output channel."""

    def __init__(self, layers):
        super().__init__()
        self.first = layers[0]
        weight = layers[2].weight.detach()[0].permute(2, 1, 0)      # column, row, channel
        self.register_buffer("taps", weight.flatten(0, 1).clone()[..., None, None])

    def forward(self, x):
        height, width = x.shape[-2:]
        left, middle, right = F.conv2d(F.relu(self.first(x)), self.taps, padding=1).split(3, 1)
        rows = left[..., :width] + middle[..., 1:width + 1] + right[..., 2:]
        above, middle, below = rows.split(1, 1)
        return above[..., :height, :] + middle[..., 1:height + 1, :] + below[..., 2:, :]


class QuickCurve(nn.Module):
    """The interpolant at Chebyshev nodes by divided differences, then all frames by one matrix."""

    def __init__(self, times, variant, n):
        super().__init__()
        nodes = torch.as_tensor(chebyshev_nodes(n), dtype=torch.float32)
        matrix = torch.as_tensor(frame_matrix(times, n), dtype=torch.float32)
        self.register_buffer("nodes", nodes.view(1, -1, 1, 1))
        self.register_buffer("matrix", matrix[..., None, None])
        self.spread = variant == PAPER

    def forward(self, blurry, derivative, keypoints):
        if self.spread:
            keypoints = spread_keypoints(keypoints)
        t, value = keypoints.split(1, 1), list(derivative.split(1, 1))
        for order in range(1, len(t)):
            for i in range(len(t) - 1, order - 1, -1):
                value[i] = (value[i] - value[i - 1]) / (t[i] - t[i - order])
        at_nodes = value[-1]
        for i in range(len(t) - 2, -1, -1):
            at_nodes = at_nodes * (self.nodes - t[i]) + value[i]
        return blurry + F.conv2d(at_nodes, self.matrix)


class Path(nn.Module):
    """U-Net, curve and refinement in a row."""

    def __init__(self, unet, curve, refine):
        super().__init__()
        self.unet, self.curve, self.refine = unet, curve, refine

    def forward(self, blurry, histogram, keypoints, between):
        """Frames N x d x H x W at the times that the path was made for."""
        return self.refine(self.curve(blurry, self.unet(blurry, histogram, keypoints), keypoints), between)


def published(model, times):
    """The published path of a model.ECIR in evaluation mode, float32."""
    return Path(PublishedUNet(model.unet), PublishedCurve(times, model.variant),
                PublishedRefinement(model.refine)).eval()


def plain(model, times):
    """The published layers with the quick curve."""
    return Path(PublishedUNet(model.unet), QuickCurve(times, model.variant, model.n),
                PublishedRefinement(model.refine)).eval()


def best(model, times):
    """The same function arranged for speed."""
    unet, refine = copy.deepcopy(model.unet), copy.deepcopy(model.refine)
    for name in ("de_conv1", "de_conv2", "de_conv3", "de_conv4"):
        setattr(unet, name, PackedUp(getattr(unet, name)))
    for name in ("first_res_net", "other_res_net", "final"):
        setattr(refine, name, PackedPolish(getattr(refine, name)))
    return Path(unet, QuickCurve(times, model.variant, model.n), PublishedRefinement(refine)).eval()


def stage_inputs(path, inputs):
    """{stage: its arguments} for one exposure's inputs: blurry, histogram, keypoints, between."""
    blurry, histogram, keypoints, between = inputs
    derivative = path.unet(blurry, histogram, keypoints)
    initial = path.curve(blurry, derivative, keypoints)
    return {"unet": (blurry, histogram, keypoints), "curve": (blurry, derivative, keypoints),
            "refine": (initial, between)}


def optimised(path, inputs):
    """`path` with each stage traced for these inputs, frozen (batch norms folded), and on a CPU prepared for oneDNN."""
    arguments, stages = stage_inputs(path, inputs), []
    for name in STAGES:
        with warnings.catch_warnings():     # that sizes become constants: they are, here
            warnings.simplefilter("ignore")
            stage = torch.jit.freeze(torch.jit.trace(getattr(path, name), arguments[name], check_trace=False))
        stages.append(torch.jit.optimize_for_inference(stage) if inputs[0].device.type == "cpu" else stage)
    return Path(*stages)
