"""Scenes from sharp videos of 120 frames a second, as the paper makes them from REDS.

The folder holds a folder of numbered frames (PNG or JPEG) for each video. A scene is a window of the
exposure's length somewhere in one of them, in grey, area-averaged to the wanted size. Between two
frames it is interpolated along optical flow (OpenCV's DIS, both ways, blended), in place of the
interpolation network that the paper uses to get from 120 to 960 frames a second.
"""
import glob
import os
import sys

import cv2
import numpy as np

FRAMES_A_SECOND = 120
EXPOSURE_SECONDS = 0.12


class Video:
    """A window of a video as a world: sharp frames at any normalised time of the exposure."""

    def __init__(self, frames):
        self.frames, self.size = frames, frames[0].shape
        self.intervals = EXPOSURE_SECONDS * FRAMES_A_SECOND
        self._flows = {}

    def _flow(self, a, b):
        """Optical flow from frame a to frame b, pixels, float32 [H, W, 2]."""
        if (a, b) not in self._flows:
            codes = [np.round(np.clip(self.frames[i], 0, 1) * 255).astype(np.uint8) for i in (a, b)]
            self._flows[a, b] = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM).calc(*codes, None)
        return self._flows[a, b]

    def _place(self, time):
        """Index of the frame before a time and the share of the interval that has passed."""
        position = (time + 1) / 2 * self.intervals
        index = min(int(position), len(self.frames) - 2)
        return index, position - index

    def render(self, time):
        """Frame at a normalised time, float32 [H, W] in [0, 1]."""
        index, share = self._place(time)
        y, x = np.indices(self.size).astype(np.float32)
        frame = np.zeros(self.size, np.float32)
        for a, b, reach in ((index, index + 1, share), (index + 1, index, 1 - share)):
            if reach < 1:
                flow = self._flow(a, b) * np.float32(reach)
                frame += np.float32(1 - reach) * cv2.remap(self.frames[a], x - flow[..., 0], y - flow[..., 1],
                                                           cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return frame

    def velocity(self, time, stride):
        """Optical flow in pixels a unit of normalised time, float32 [2, H / stride, W / stride]."""
        index, _ = self._place(time)
        cells = (self.size[1] // stride, self.size[0] // stride)
        flow = cv2.resize(self._flow(index, index + 1), cells, interpolation=cv2.INTER_AREA)
        return flow.transpose(2, 0, 1) * np.float32(self.intervals / 2)

    def travel(self):
        """Length of the path of the median flow, pixels."""
        steps = [np.median(self._flow(i, i + 1), (0, 1)) for i in range(len(self.frames) - 1)]
        return float(np.hypot(*np.array(steps).T).sum() * self.intervals / len(steps))

    def fastest(self):
        """Upper end of how far parts of the picture move, pixels."""
        return max(float(np.percentile(np.hypot(*np.moveaxis(self._flow(i, i + 1), 2, 0)), 98))
                   for i in range(len(self.frames) - 1)) * self.intervals


class Videos:
    """All videos of a folder; world() takes a random window of a random one."""

    def __init__(self, folder):
        self.videos = []
        self.needed = int(np.ceil(EXPOSURE_SECONDS * FRAMES_A_SECOND)) + 1
        for name in sorted(os.listdir(folder)) if os.path.isdir(folder) else ():
            files = sorted(f for kind in ("png", "jpg") for f in glob.glob(os.path.join(folder, name, "*." + kind)))
            if len(files) >= self.needed:
                self.videos.append(files)
        if not self.videos:
            sys.exit(f"pack: '{folder}' holds no folder with at least {self.needed} frames (.png or .jpg)")

    def world(self, rng, size, travel):
        """A window in random mirroring; the travel is the video's own."""
        files = self.videos[rng.integers(len(self.videos))]
        first = int(rng.integers(len(files) - self.needed + 1))
        frames = []
        for name in files[first:first + self.needed]:
            frame = cv2.imread(name, cv2.IMREAD_GRAYSCALE)
            if frame is None:
                sys.exit(f"pack: {name} cannot be decoded; remove it or its folder")
            frames.append(self._fit(frame, size))
        return Video(frames)

    @staticmethod
    def _fit(frame, size):
        """The middle of the frame in the wanted shape, area-averaged to the size, [0, 1]."""
        height, width = frame.shape
        scale = min(height / size[0], width / size[1])
        rows, columns = int(size[0] * scale), int(size[1] * scale)
        top, left = (height - rows) // 2, (width - columns) // 2
        part = frame[top:top + rows, left:left + columns].astype(np.float32) / 255
        return cv2.resize(part, size[::-1], interpolation=cv2.INTER_AREA)
