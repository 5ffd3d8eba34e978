"""eSL-Net without super-resolution (Wang et al., "Event Enhanced High-Quality Image Recovery",
ECCV 2020): the network, and the event counts that it sees for a frame at one time.

Tensors are N x C x H x W, intensities in grey levels 0 ... 255, event counts raw. Names in the
state dict are the published ones; `esl.` is their prefix in an exported file.
"""
import numpy as np
import torch
import torch.nn as nn

CHANNELS, CODES = 40, 128  # image and event channels; of the sparse code
ROUNDS = 25                # of the iterative shrinkage
BINS = CHANNELS // 2
FRACTION = 1024            # a frame's instant is a whole number of 1/1024 us
PREFIX = "esl."


def frame_instant(time, start, end):
    """Normalised time as 1/1024 us after the exposure's start, an int: from here on all is exact."""
    return int(np.rint((np.float64(time) + 1) / 2 * np.float64((int(end) - int(start)) * FRACTION)))


def outward_counts(t, x, y, p, start, end, time, size):
    """Event counts for a frame at normalised `time`, int64 [2 BINS, H, W], size = (H, W).

    t: int64 microseconds inside [start, end]. Bin k = floor(distance from the frame's instant /
    (exposure / BINS)), the last one closed. Channel 2k counts what is positive after the instant
    or negative before it, 2k + 1 the rest; an event at the instant is after it.
    """
    distance = (np.asarray(t, np.int64) - int(start)) * FRACTION - frame_instant(time, start, end)
    k = np.minimum(BINS * np.abs(distance) // ((int(end) - int(start)) * FRACTION), BINS - 1)
    channel = 2 * k + ((np.asarray(p) <= 0) != (distance < 0))
    counts = np.zeros((2 * BINS,) + tuple(size), np.int64)
    np.add.at(counts, (channel, np.asarray(y, np.int64), np.asarray(x, np.int64)), 1)
    return counts


def _conv(cin, cout, kernel):
    return nn.Conv2d(cin, cout, kernel, padding=kernel // 2, bias=False)


class ShrinkageLayer(nn.Module):
    """A non-negative sparse code by 25 rounds of learned iterative shrinkage, S1 and S2 shared."""

    def __init__(self):
        super().__init__()
        self.W1 = _conv(CHANNELS, CODES, 3)
        self.S1 = _conv(CODES, CHANNELS, 3)
        self.S2 = _conv(CHANNELS, CODES, 3)

    def forward(self, image, gate):
        start = self.W1(image * gate)
        code = start.relu()
        for _ in range(ROUNDS):
            code = (code - self.S2(self.S1(code) * gate * gate) + start).relu()
        return code


class EslNet(nn.Module):
    def __init__(self):
        super().__init__()
        self.image_d = _conv(1, CHANNELS, 1)
        self.event_c1 = _conv(CHANNELS, CHANNELS, 1)
        self.event_c2 = _conv(CHANNELS, CHANNELS, 1)
        self.scn = nn.ModuleList([ShrinkageLayer()])
        self.W2 = _conv(CODES, CHANNELS, 3)
        self.endconv = _conv(CHANNELS, 1, 3)

    def forward(self, blurry, counts):
        """blurry N x 1, counts N x 40 (all x H x W) -> sharp frame N x 1 x H x W."""
        gate = torch.sigmoid(self.event_c2(torch.sigmoid(self.event_c1(counts))))
        return self.endconv(self.W2(self.scn[0](self.image_d(blurry), gate)))


def load_esl_net(path):
    """EslNet in evaluation mode from a file that import_esl_net.py wrote."""
    from export import read_safetensors
    tensors, metadata = read_safetensors(path)
    if metadata.get("model") != "esl_net":
        raise ValueError(f"{path}: metadata says model '{metadata.get('model')}', not 'esl_net'")
    net = EslNet()
    net.load_state_dict({name[len(PREFIX):]: torch.from_numpy(value.astype(np.float32))
                         for name, value in tensors.items() if name.startswith(PREFIX)})
    return net.eval()


def export_esl_net(path, state, training, dtype=np.float32, **more):
    """Writes name -> array under the published names; `more`: further arrays under their own."""
    from export import write_safetensors
    write_safetensors(path, {PREFIX + name: np.asarray(value, dtype) for name, value in state.items()} | more,
                      {"model": "esl_net", "training": training})
