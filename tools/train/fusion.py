"""The fusion network: frames of the event-driven prior, brought together along the motion.

The prior (prior.py) gives a noisy frame at any time. Its errors are a pixel's own, so the same
point of the scene, seen by other pixels at other times, has other errors: averaging along the motion
removes them. The motion is estimated from the prior alone (motion.py), nothing in it is learned. For a
wanted time, positions follow the motion to all ANCHORS, the prior's frames are fetched there,
and the head turns what agrees and what does not into a correction of the prior at that time. The trunk
looks at the exposure once and gives the head features that are polynomials in time.

Tensors are N x C x H x W, intensities [0, 1], times normalised to [-1, 1], velocities in pixels a
unit of time.
"""
import torch
import torch.nn as nn
import torch.nn.functional as F

import motion

ANCHORS = len(motion.ANCHORS)   # frames of the prior, at even times from -1 to 1
GAPS = motion.GAPS      # between neighbouring ones
PLANES = ANCHORS + 7    # of the head's input
STRIDE = motion.CELL    # pixels a side of a cell of the motion
BASIS = 4           # Chebyshev polynomials of time that the trunk's features for the head are made of
REFERENCES = (0, 4, 8)  # anchors whose corrected frames all others are compared with
TOLERANCE = 0.015       # of full scale, of what agrees with them
COUNT_SCALE = 0.25
VELOCITY_SCALE = 0.05


class _Residual(nn.Module):
    """relu(x + conv(relu(conv(x))))"""

    def __init__(self, channels):
        super().__init__()
        self.a = nn.Conv2d(channels, channels, 3, padding=1)
        self.b = nn.Conv2d(channels, channels, 3, padding=1)

    def forward(self, x):
        return F.relu(x + self.b(F.relu(self.a(x), inplace=True)), inplace=True)


class _Up(nn.Module):
    """Transposed 3x3 convolution, stride 2, plus the skip connection, whose size it takes; ReLU."""

    def __init__(self, cin, cout):
        super().__init__()
        self.conv = nn.ConvTranspose2d(cin, cout, 3, stride=2, padding=1)

    def forward(self, x, skip):
        """As self.conv(x, output_size=...), by one 2x2 convolution for the four phases: faster on a CPU."""
        # Even outputs meet tap 1 alone, odd ones tap 2 and, of the next input, tap 0.
        weight = self.conv.weight
        zero = torch.zeros_like(weight[:, :, :1])
        weight = torch.stack([torch.cat([weight[:, :, 1:2], zero], 2), weight[:, :, [2, 0]]], 2)
        zero = torch.zeros_like(weight[..., :1])
        weight = torch.stack([torch.cat([weight[..., 1:2], zero], -1), weight[..., [2, 0]]], 3)
        weight = weight.flatten(1, 3).transpose(0, 1)   # cout, row and column parity; cin, 2, 2
        bias = self.conv.bias.repeat_interleave(4)
        height, width = skip.shape[-2:]
        x = F.pixel_shuffle(F.conv2d(F.pad(x, (0, 1, 0, 1)), weight, bias), 2)[..., :height, :width]
        return F.relu(x + skip, inplace=True)


def _down(cin, cout, kernel=3):
    return nn.Conv2d(cin, cout, kernel, stride=2, padding=kernel // 2)


class Trunk(nn.Module):
    """Once an exposure: features for the head, at a quarter of the resolution."""

    def __init__(self, widths, head_width):
        super().__init__()
        a, b, c, d = widths
        self.down1 = _down(2 * ANCHORS, a)      # anchors, blurry frame, counts between anchors
        self.down2, self.res2 = _down(a, b), _Residual(b)
        self.down3, self.res3 = _down(b, c), _Residual(c)
        self.motion = nn.Conv2d(2 * ANCHORS, c, 3, padding=1, bias=False)
        self.down4, self.res4, self.res5 = _down(c, d), _Residual(d), _Residual(d)
        self.up3, self.res6 = _Up(d, c), _Residual(c)
        self.up2, self.res7 = _Up(c, b), _Residual(b)
        self.feature = nn.Conv2d(b, BASIS * head_width, 3, padding=1)

    def forward(self, anchors, blurry, counts, velocity):
        """anchors N x 9, blurry N x 1, counts N x 8, velocity N x 18 (x, y by anchor, a cell of 8
        pixels) -> N x BASIS * head width."""
        x = torch.cat([anchors, blurry, COUNT_SCALE * torch.log2(1 + counts)], 1)
        x = F.relu(self.down1(x.contiguous(memory_format=torch.channels_last)))
        x2 = self.res2(F.relu(self.down2(x)))
        x3 = self.motion((VELOCITY_SCALE * velocity).contiguous(memory_format=torch.channels_last))
        x3 = self.res3(F.relu(self.down3(x2) + x3))
        x4 = self.res5(self.res4(F.relu(self.down4(x3))))
        x3 = self.res6(self.up3(x4, x3))
        x2 = self.res7(self.up2(x3, x2))
        return self.feature(x2)


class Head(nn.Module):
    """Once a wanted frame: the correction of the prior."""

    def __init__(self, widths):
        super().__init__()
        a, b, c = widths
        self.skip = nn.Conv2d(PLANES, a, 3, padding=1, bias=False)
        self.down1 = _down(PLANES, b, 5)
        self.down2 = _down(b, c)
        self.res2, self.res3 = _Residual(c), _Residual(c)
        self.up1, self.res1 = _Up(c, b), _Residual(b)
        self.up0 = _Up(b, a)
        self.out = nn.Conv2d(a, 1, 3, padding=1)

    def forward(self, planes, feature):
        """planes N x 16 x H x W, feature N x head width x cells -> N x 1 x H x W."""
        planes = planes.contiguous(memory_format=torch.channels_last)
        x1 = F.relu(self.down1(planes))
        x2 = F.relu(self.down2(x1) + feature)
        x2 = self.res3(self.res2(x2))
        x1 = self.res1(self.up1(x2, x1))
        return self.out(self.up0(x1, self.skip(planes))).float()


def pixel_grid(height, width, stride, device):
    """Centres of stride x stride cells, 2 x h x w (x, y), pixels."""
    rows = torch.arange(-(-height // stride), device=device, dtype=torch.float32) * stride + (stride - 1) / 2
    columns = torch.arange(-(-width // stride), device=device, dtype=torch.float32) * stride + (stride - 1) / 2
    return torch.stack([columns[None].expand(len(rows), -1), rows[:, None].expand(-1, len(columns))])


def sample(field, position, stride):
    """Bilinear values of field N x C x h x w (cells of stride pixels) at N x 2 x i x j pixel
    positions; beyond the border its value."""
    size = torch.tensor([field.shape[3], field.shape[2]], device=field.device) * (0.5 * stride)
    grid = (position.permute(0, 2, 3, 1) + 0.5) / size - 1
    return F.grid_sample(field, grid, mode="bilinear", padding_mode="border", align_corners=False)


def velocities(moved):
    """Velocity at the anchors, N x 9 x 2 x h x w in pixels a unit of time, from the gaps' displacements N x 8 x ..."""
    speed = moved * (0.5 * GAPS)
    return torch.cat([speed[:, :1], 0.5 * (speed[:, 1:] + speed[:, :-1]), speed[:, -1:]], 1)


def trajectories(moved, times, height, width):
    """Where what is at each cell's centre at times [N] is at the anchors: N x ANCHORS x 2 x h x w.

    moved: N x GAPS x 2 x h x w, from gap to gap. A gap's displacement is known by where things are half-way
    through it, so it is read at a first guess of that.
    """
    count = moved.shape[0]
    every = torch.arange(count, device=moved.device)
    place = (times + 1) * (0.5 * GAPS)
    below = place.floor().clamp(0, GAPS - 1).long()
    share = (place - below).view(-1, 1, 1, 1)
    start = pixel_grid(height, width, STRIDE, moved.device).to(moved.dtype)[None].expand(count, -1, -1, -1)

    def gap_moved(gap, position, ahead):
        """Of what is at a position when `ahead` of the gap is still to come until its middle."""
        field = moved[every, gap]
        return sample(field, position + ahead * sample(field, position, STRIDE), STRIDE)

    def chain(position, direction, first):
        """Positions at anchors on from the one where `position` is, through gaps first, ..., repeating the last."""
        found = [position]
        for i in range(GAPS - 1):
            gap = first + direction * i
            inside = ((gap >= 0) & (gap < GAPS)).view(-1, 1, 1, 1)
            step = direction * gap_moved(gap.clamp(0, GAPS - 1), position, 0.5 * direction)
            position = torch.where(inside, position + step, position)
            found.append(position)
        return torch.stack(found, 1)
    around = gap_moved(below, start, 0.5 - share)
    back = chain(start - share * around, -1, below - 1)
    forth = chain(start + (1 - share) * around, 1, below + 1)
    anchor = torch.arange(ANCHORS, device=moved.device)[None]
    past = anchor <= below[:, None]
    steps = torch.where(past, below[:, None] - anchor, anchor - below[:, None] - 1)
    picked = torch.where(past, steps, steps + back.shape[1])
    return torch.cat([back, forth], 1)[every[:, None], picked]


def fetch(frames, path):
    """Frames M x K x H x W, each where path M x K x 2 x cells leads, bilinear, and whether that is inside."""
    count, every, height, width = frames.shape
    away = (path - pixel_grid(height, width, STRIDE, path.device)).flatten(0, 1)
    away = F.interpolate(away, scale_factor=STRIDE, mode="bilinear", align_corners=False)[..., :height, :width]
    position = away + pixel_grid(height, width, 1, path.device)
    limit = torch.tensor([width, height], device=path.device).view(1, 2, 1, 1) - 0.5
    inside = ((position >= -0.5) & (position <= limit)).all(1)
    fetched = sample(frames.flatten(0, 1)[:, None], position, 1)
    return fetched.view_as(frames), inside.view_as(frames)


def agree(frames, references, moved, times):
    """Refinement across time, nothing in it is learned: corrected frames M x H x W averaged with those of the
    REFERENCES, M x 3 x H x W, as far as they agree along the motion, M x GAPS x 2 x cells. Times [M]."""
    path = trajectories(moved, times, *frames.shape[-2:])[:, list(REFERENCES)]
    fetched, inside = fetch(references, path)
    difference = torch.where(inside, fetched - frames[:, None], torch.zeros_like(fetched))
    square = F.avg_pool2d(F.pad(difference.square(), (1, 1, 1, 1), "replicate"), 3, 1)
    weight = torch.exp(-square / TOLERANCE ** 2)
    return frames + (weight * difference).sum(1) / (1 + weight.sum(1))


class Fusion(nn.Module):
    """Trunk and head; widths of the trunk at 1/2, 1/4, 1/8, 1/16 of the resolution, of the head at 1, 1/2, 1/4."""

    def __init__(self, trunk=(32, 64, 96, 128), head=(16, 32, 48)):
        super().__init__()
        self.widths = (tuple(trunk), tuple(head))
        self.trunk, self.head = Trunk(trunk, head[2]), Head(head)
        with torch.no_grad():   # start from the prior as it is
            self.head.out.weight.mul_(0.1)
            self.head.out.bias.zero_()

    @staticmethod
    def planes(moved, anchors, blurry, prior, surfaces, times):
        """Input of the head, M x 16: prior at t, blurry frame, the anchors fetched along the motion
        minus the prior, nearest in time first, surfaces times L + 0.01 and thresholds, t^2."""
        height, width = prior.shape[-2:]
        path = trajectories(moved, times, height, width)
        count = path.shape[0]
        fetched, inside = fetch(anchors, path)
        difference = torch.where(inside, fetched - prior, torch.zeros_like(fetched))
        anchor = torch.arange(ANCHORS, device=path.device)[None]
        order = ((times[:, None] + 1) * (0.5 * (ANCHORS - 1)) - anchor).abs().argsort(dim=1, stable=True)
        difference = difference[torch.arange(count, device=path.device)[:, None], order]
        square = (times * times).view(-1, 1, 1, 1).expand(-1, -1, height, width)
        return torch.cat([prior, blurry, difference, surfaces * (prior + 0.01), square], 1)

    def correct(self, planes, feature, times):
        """Frames M x 1 from the head's input and the features M x BASIS x C x h x w."""
        basis = torch.stack([torch.ones_like(times), times, 2 * times ** 2 - 1, 4 * times ** 3 - 3 * times], 1)
        mixed = (feature * basis.to(feature.dtype)[:, :, None, None, None]).sum(1)
        return planes[:, :1] + self.head(planes, mixed)

    def forward(self, exposure, prior, surfaces, times, mixed=False):
        """Frames N x T x H x W at times [N, T].

        exposure: anchors N x 9 x H x W, blurry N x 1, counts N x 8, moved N x 8 x 2 x cells. prior:
        N x T x H x W; surfaces: N x T x 4 x H x W, already times the thresholds. mixed: convolutions in
        bfloat16, everything else in float32.
        """
        precision = torch.autocast(prior.device.type, torch.bfloat16, enabled=mixed)
        anchors, blurry, counts, moved = exposure
        with precision:
            feature = self.trunk(anchors, blurry, counts, velocities(moved).flatten(1, 2)).unflatten(1, (BASIS, -1))
        each = times.shape[1]

        def spread(value):
            return value.repeat_interleave(each, 0)
        flat = times.flatten()
        planes = self.planes(spread(moved), spread(anchors), spread(blurry), prior.flatten(0, 1)[:, None],
                             surfaces.flatten(0, 1), flat)
        with precision:
            frames = self.correct(planes, spread(feature), flat)
        return frames.view_as(prior)
