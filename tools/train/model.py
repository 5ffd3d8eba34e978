"""The E-CIR network: derivative U-Net, Lagrange curve and recurrent refinement.

Tensors are N x C x H x W. Intensities are in [0, 1], time is normalised to [-1, 1] over the
exposure, event counts are raw. Names in the state dicts are those of the published
implementation; `unet.` and `refine.` are the two prefixes of an exported file.
"""
import math

import numpy as np
import torch
import torch.nn as nn
import torch.nn.functional as F

PAPER, RELEASE = "paper", "release"
RELEASE_INTERVALS = 13  # the published weights see 13 intervals, 26 channels
SPACING = 1.0 / 16.0    # smallest keypoint distance, as a share of the pivots' distance


def pivots(n):
    """The n evenly spaced times of [-1, 1] that keypoints start from, float64 [n]."""
    index = np.arange(n, dtype=np.float64)
    return (2.0 * index - (n - 1)) / (n - 1)


def chebyshev_nodes(n):
    """Nodes x_k = -cos((2k + 1) pi / 2n), float64 [n], ascending."""
    return -np.cos((2.0 * np.arange(n) + 1.0) * np.pi / (2.0 * n))


def frame_matrix(times, n):
    """S [d, n], float64: L(t) = blurry + sum_k S[t, k] P(x_k)  (equations 3 and 7).

    times: d normalised times. P is the interpolated derivative (equation 6) at the Chebyshev
    nodes; S integrates its interpolant from -1 to t and takes the exposure's mean off, so that the
    mean of L is exactly the blurry frame.
    """
    cheb = np.polynomial.chebyshev
    to_coefficients = np.linalg.inv(cheb.chebvander(chebyshev_nodes(n), n - 1))
    primitive = np.stack([cheb.chebint(to_coefficients[:, k], lbnd=-1) for k in range(n)], axis=1)
    second = np.stack([cheb.chebint(primitive[:, k], lbnd=-1) for k in range(n)], axis=1)
    value = cheb.chebvander(np.asarray(times, np.float64), n) @ primitive
    mean = 0.5 * cheb.chebvander(np.ones(1), n + 1) @ second
    return value - mean


def spread_keypoints(keypoints):
    """Keypoints with a distance of at least SPACING * 2 / (n - 1), for the `paper` curve.

    Two events just on either side of a cell border would make the Lagrange weights explode.
    keypoints: N x n x H x W, ascending in each pixel.
    """
    n = keypoints.shape[1]
    delta = 2.0 / (n - 1) * SPACING
    t = list(keypoints.unbind(1))
    for i in range(1, n):
        t[i] = torch.maximum(t[i], t[i - 1] + delta)
    over = t[-1] > 1
    t[-1] = torch.where(over, torch.ones_like(t[-1]), t[-1])
    for i in range(n - 2, -1, -1):
        t[i] = torch.where(over, torch.minimum(t[i], t[i + 1] - delta), t[i])
    return torch.stack(t, 1)


def lagrange_basis(keypoints, nodes):
    """Lagrange bases beta_i(x_k), N x K x n x H x W (equation 6), by prefix and suffix products.

    keypoints: N x n x H x W; nodes: [K]. No division per node, so a node may meet a keypoint.
    """
    n = keypoints.shape[1]
    t = keypoints.unbind(1)
    nodes = torch.as_tensor(nodes, dtype=keypoints.dtype, device=keypoints.device)
    difference = [nodes.view(1, -1, 1, 1) - t[i].unsqueeze(1) for i in range(n)]
    suffix = [None] * n
    for i in range(n - 2, -1, -1):
        suffix[i] = difference[i + 1] if suffix[i + 1] is None else suffix[i + 1] * difference[i + 1]
    basis, prefix = [], None
    for i in range(n):
        weight = torch.ones_like(t[i])
        for j in range(n):
            if j != i:
                weight = weight * (t[i] - t[j])
        product = weight.reciprocal().unsqueeze(1)
        for factor in (prefix, suffix[i]):
            product = product if factor is None else product * factor
        basis.append(product.expand(-1, nodes.numel(), -1, -1))
        prefix = difference[i] if prefix is None else prefix * difference[i]
    return torch.stack(basis, 2)


def derivative_at_nodes(derivative, keypoints, variant, nodes=None):
    """P(x_k) of equation 6, N x K x H x W; derivative and keypoints: N x n x H x W.

    The `paper` variant spreads the keypoints first, `release` takes them as they are.
    """
    nodes = chebyshev_nodes(keypoints.shape[1]) if nodes is None else nodes
    with torch.no_grad():
        basis = lagrange_basis(spread_keypoints(keypoints) if variant == PAPER else keypoints, nodes)
    return (basis * derivative.unsqueeze(1)).sum(2)


def render(blurry, node_values, matrix):
    """Frames L(t), N x d x H x W, of equation 7: blurry (N x 1 x H x W) + S P.

    node_values: N x n x H x W; matrix: S of frame_matrix, [d, n], or [N, d, n] for times that
    differ inside the batch.
    """
    matrix = torch.as_tensor(matrix, dtype=node_values.dtype, device=node_values.device)
    flat = node_values.flatten(2)
    change = torch.matmul(matrix, flat)
    return blurry + change.unflatten(2, node_values.shape[2:])


def _conv5(cin, cout):
    return nn.Sequential(nn.Conv2d(cin, cout, 5, stride=2, padding=2), nn.ReLU(inplace=True))


def _residual_block(c):
    return nn.Sequential(nn.Conv2d(c, c, 3, padding=1, bias=False), nn.BatchNorm2d(c),
                         nn.ReLU(inplace=True),
                         nn.Conv2d(c, c, 3, padding=1, bias=False), nn.BatchNorm2d(c))


class _Up(nn.Sequential):
    """Transposed 5x5 convolution, stride 2, whose output has the size of the skip connection."""

    def __init__(self, cin, cout):
        super().__init__(nn.ConvTranspose2d(cin, cout, 5, stride=2, padding=2, bias=False))

    def packed_weight(self):
        """Weight [4 cout, cin, 3, 3] whose convolution gives the outputs' four parities as channels."""
        # Even outputs meet taps 4, 2, 0 and odd ones none, 3, 1 at the input offsets -1, 0, 1.
        weight = F.pad(self[0].weight, (0, 1, 0, 1)).flip(2, 3)
        weight = weight.unflatten(3, (3, 2)).unflatten(2, (3, 2)).flip(3, 5)
        return weight.permute(1, 3, 5, 0, 2, 4).flatten(0, 2)   # cout, row and column parity; cin, 3, 3

    def forward(self, x, size):
        """As self[0](x, output_size=size), by four 3x3 convolutions: twice as fast on a CPU."""
        x = F.conv2d(x, self.packed_weight(), padding=1)
        return F.relu(F.pixel_shuffle(x, 2)[..., :size[0], :size[1]])


class UNet(nn.Module):
    """dL/dt at the n keypoints from the blurry frame, the histogram and the keypoints (figure 3)."""

    def __init__(self, width=64, bins=40, n=10):
        super().__init__()
        w, cin = width, 1 + bins + n
        self.en_conv1 = _conv5(cin, w)
        self.en_conv2 = _conv5(w, 2 * w)
        self.en_conv3 = _conv5(2 * w, 4 * w)
        self.en_conv4 = _conv5(4 * w, 8 * w)
        self.res1 = _residual_block(8 * w)
        self.res2 = _residual_block(8 * w)
        self.de_conv1 = _Up(8 * w, 4 * w)
        self.de_conv2 = _Up(8 * w, 2 * w)
        self.de_conv3 = _Up(4 * w, w)
        self.de_conv4 = _Up(2 * w, w // 2)
        self.pred = nn.Conv2d(w // 2 + cin, n, 1)

    def forward(self, blurry, histogram, keypoints):
        """blurry N x 1, histogram N x m, keypoints N x n (all x H x W) -> derivatives N x n x H x W."""
        x0 = torch.cat([blurry, histogram, keypoints], 1).contiguous(memory_format=torch.channels_last)
        x1 = self.en_conv1(x0)
        x2 = self.en_conv2(x1)
        x3 = self.en_conv3(x2)
        x4 = self.en_conv4(x3)
        x4 = F.relu(self.res1(x4) + x4)
        x4 = F.relu(self.res2(x4) + x4)
        y3 = self.de_conv1(x4, x3.shape[-2:])
        y2 = self.de_conv2(torch.cat([y3, x3], 1), x2.shape[-2:])
        y1 = self.de_conv3(torch.cat([y2, x2], 1), x1.shape[-2:])
        y0 = self.de_conv4(torch.cat([y1, x1], 1), x0.shape[-2:])
        # Derivatives stay out of mixed precision: close keypoints amplify their rounding.
        with torch.autocast("cpu", enabled=False):
            return self.pred(torch.cat([y0.to(x0.dtype), x0], 1)).contiguous()


def _polish(cin):
    return nn.Sequential(nn.Conv2d(cin, 32, 3, padding=1, bias=False), nn.ReLU(inplace=True),
                         nn.Conv2d(32, 1, 3, padding=1, bias=False))


def backward_gradient(frame):
    """Left minus pixel and upper minus pixel, N x 2 x H x W; 0 on the first column and row."""
    dx = F.pad(frame[..., :, :-1] - frame[..., :, 1:], (1, 0, 0, 0))
    dy = F.pad(frame[..., :-1, :] - frame[..., 1:, :], (0, 0, 1, 0))
    return torch.cat([dx, dy], 1)


class RefineNet(nn.Module):
    """Algorithm 1: recurrent residuals, gradient steps on equation 8, final polish.

    bounded: no step is longer than the largest that keeps equation 8 from growing (layers/refine.hpp).
    """

    def __init__(self, iterations=3, bounded=True):
        super().__init__()
        self.iterations, self.bounded = iterations, bounded
        self.first_res_net = _polish(8)
        self.other_res_net = _polish(9)
        self.alpha_net = nn.Conv2d(1, 1, 3, padding=1)
        self.final = _polish(1)

    def forward(self, initial, histogram):
        """initial N x d x H x W, histogram N x 2(d-1) x H x W between consecutive (sorted) frames.

        Returns the refined frames N x d x H x W and the residuals, one N x (d-1) x H x W an
        iteration.
        """
        start = list(initial.split(1, 1))
        d = len(start)
        frames, residuals = start, []
        largest = 1 / (3 + 2 * math.cos(math.pi / d)) if self.bounded else math.inf
        for _ in range(self.iterations):
            gradient = [backward_gradient(f) for f in frames]
            r = []
            for i in range(d - 1):
                x = [frames[i], frames[i + 1], gradient[i], gradient[i + 1],
                     histogram[:, 2 * i:2 * i + 2]]
                r.append(self.first_res_net(torch.cat(x, 1)) if i == 0 else
                         self.other_res_net(torch.cat(x + [r[-1]], 1)))
            updated = []
            for i in range(d):
                direction = 2 * (frames[i] - start[i])
                if i > 0:
                    direction = direction - 2 * (frames[i - 1] + r[i - 1] - frames[i])
                if i < d - 1:
                    direction = direction + 2 * (frames[i] + r[i] - frames[i + 1])
                alpha = (0.1 * F.relu(self.alpha_net(frames[i]))).clamp(max=largest)
                updated.append(frames[i] - alpha * direction)
            frames = updated
            if r:
                residuals.append(torch.cat(r, 1))
        return torch.cat([self.final(f) for f in frames], 1), residuals


class ECIR(nn.Module):
    """Both networks and the curve between them (figure 3)."""

    def __init__(self, variant=PAPER, width=64, bins=40, n=10, iterations=3):
        super().__init__()
        if variant not in (PAPER, RELEASE):
            raise ValueError(f"unknown variant '{variant}': use '{PAPER}' or '{RELEASE}'")
        if width < 2 or width % 2 or bins < 2 or bins % 2 or n < 2:
            raise ValueError("width and histogram bins must be even and at least 2, keypoints at least 2")
        self.variant, self.width, self.bins, self.n = variant, width, bins, n
        self.unet = UNet(width, bins, n)
        self.refine = RefineNet(iterations, bounded=variant == PAPER)

    def initialise(self, blurry, histogram, keypoints, times):
        """Initial frames N x d x H x W at d normalised times shared by the batch."""
        derivative = self.unet(blurry, histogram, keypoints)
        values = derivative_at_nodes(derivative, keypoints, self.variant)
        return render(blurry, values, frame_matrix(times, self.n))

    def forward(self, blurry, histogram, keypoints, times, interval_histogram):
        """Initial and refined frames, each N x d x H x W, at ascending normalised times."""
        initial = self.initialise(blurry, histogram, keypoints, times)
        return initial, self.refine(initial, interval_histogram)[0]
