"""Random moving scenes from still photos: camera motion, objects that occlude, graphics, defocus.

Time is normalised to [-1, 1] over the exposure, coordinates are pixels, intensities are
display-referred in [0, 1] (saturated parts beyond 1). Everything is a pure function of the
generator passed in.
"""
import glob
import os
import sys

import cv2
import numpy as np

GRID = np.linspace(-1.0, 1.0, 513)      # times at which motion is tabulated
LEAST_CONTRAST, MOST_WHITE = 0.04, 0.5  # of a view: its standard deviation, and its share of saturated pixels
CONTENT_DRAWS = 20


def load_photos(folder):
    """Grey photos of a folder as float32 [0, 1]; exits with advice when there are none."""
    files = sorted(f for kind in ("png", "jpg", "jpeg") for f in glob.glob(os.path.join(folder, "*." + kind)))
    photos = [cv2.imread(f, cv2.IMREAD_GRAYSCALE) for f in files]
    for name, photo in zip(files, photos):
        if photo is None:
            sys.exit(f"simulate: {name} cannot be decoded; remove it from the folder")
    if not photos:
        sys.exit(f"simulate: no .png or .jpg pictures in '{folder}'; pass a folder of photos with --images")
    return Photos(photo.astype(np.float32) / 255 for photo in photos)


class Photos(list):
    """Grey float32 photos, from which random worlds are made."""

    def world(self, rng, size, travel):
        return World(rng, self, size, travel)


class StandingPhotos(Photos):
    """Photos from which worlds are made that a standing camera sees: objects move, the background does not."""

    def world(self, rng, size, travel):
        return World(rng, self, size, travel, standing=True)


class Motion:
    """A homography over time, from centred picture coordinates to the surface's own, in pixels.

    The translation's path has the length `travel`; rotation, zoom and perspective move the
    picture's corners by a share of it.
    """

    def __init__(self, rng, size, travel):
        height, width = size
        kind = rng.random()
        if kind < 0.35:     # shake: reverses inside the exposure
            omega, phase = rng.uniform(1.2, 7.0, 2), rng.uniform(0, 2 * np.pi, 2)
            velocity = np.cos(omega[:, None] * GRID + phase[:, None]) * rng.uniform(0.2, 1.0, (2, 1))
        elif kind < 0.55:   # straight and even
            heading = rng.uniform(0, 2 * np.pi)
            velocity = np.stack([np.full_like(GRID, np.cos(heading)), np.full_like(GRID, np.sin(heading))])
        else:               # sweep along a bending line with changing speed
            heading = rng.uniform(0, 2 * np.pi) + rng.uniform(-0.9, 0.9) * GRID
            speed = np.exp(rng.uniform(0, 0.9) * np.sin(rng.uniform(0.5, 4.0) * GRID + rng.uniform(0, 2 * np.pi)))
            velocity = speed * np.stack([np.cos(heading), np.sin(heading)])
        shift = self._integrate(velocity)
        length = np.hypot(*np.diff(shift)).sum()
        self.shift = shift * (travel / max(length, 1e-9))
        wave = np.cos(rng.uniform(0.3, 4.0, (4, 1)) * GRID + rng.uniform(0, 2 * np.pi, (4, 1)))
        corner = 0.5 * np.hypot(height, width)
        # Corner displacement over the exposure: up to 0.5 of the travel for angle and zoom each.
        strength = rng.uniform(0, 0.5, 4) * (rng.random(4) < (0.6, 0.6, 0.25, 0.25))
        path = self._integrate(wave)
        span = np.maximum(np.ptp(path, axis=1), 1e-9)
        self.angle, self.log_zoom, *tilt = path * (strength * travel / corner / span)[:, None]
        self.tilt = np.stack(tilt) / corner

    @staticmethod
    def _integrate(rate):
        path = np.concatenate([np.zeros((len(rate), 1)), np.cumsum(0.5 * (rate[:, 1:] + rate[:, :-1]), 1)], 1)
        return path - path[:, GRID.size // 2][:, None]

    def matrix(self, time):
        """3x3 homography at a normalised time."""
        def at(row):
            return np.interp(time, GRID, row)
        scale = np.exp(at(self.log_zoom))
        c, s = scale * np.cos(at(self.angle)), scale * np.sin(at(self.angle))
        return np.array([[c, -s, at(self.shift[0])], [s, c, at(self.shift[1])],
                         [at(self.tilt[0]), at(self.tilt[1]), 1.0]])

    def travel(self):
        """Length of the translation's path in pixels."""
        return float(np.hypot(*np.diff(self.shift)).sum())

    def velocity(self, time, points, step=2e-3):
        """Picture velocity, pixels a unit of normalised time, of what is seen at centred points [2, N]."""
        homogeneous = np.concatenate([points, np.ones((1, points.shape[1]))])
        late, early = min(time + step, 1.0), max(time - step, -1.0)
        ends = []
        for other in (late, early):
            moved = np.linalg.solve(self.matrix(other), self.matrix(time) @ homogeneous)
            ends.append(moved[:2] / moved[2])
        return (ends[0] - ends[1]) / (late - early)


class Surface:
    """A texture seen through a moving window; zoom texture pixels to a picture pixel."""

    def __init__(self, texture, size, motion, zoom, origin, border=cv2.BORDER_REFLECT_101):
        self.size, self.motion, self.border = size, motion, border
        # The window samples every zoom-th pixel: low-pass first, or edges flicker as they move.
        self.texture = cv2.GaussianBlur(texture, (0, 0), 0.38 * zoom) if zoom > 0.8 else texture
        self.to_texture = np.array([[zoom, 0, origin[0]], [0, zoom, origin[1]], [0, 0, 1.0]])

    def render(self, time):
        """Frame at a normalised time, float32 [H, W]."""
        height, width = self.size
        centre = np.array([[1, 0, -(width - 1) / 2], [0, 1, -(height - 1) / 2], [0, 0, 1.0]])
        return cv2.warpPerspective(self.texture, self.to_texture @ self.motion.matrix(time) @ centre,
                                   (width, height), borderMode=self.border,
                                   flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)


def random_origin(rng, texture, size, motion, zoom):
    """A place from which the window stays inside the texture, as far as it can."""
    reach = (np.abs(motion.shift).max(1) + (size[1] / 2, size[0] / 2)) * zoom
    extent = np.array(texture.shape[::-1], float)
    low = np.minimum(reach, extent / 2)
    return low + rng.random(2) * (extent - 2 * low)


def random_graphics(rng, side=512):
    """Drawn texture with hard edges: shapes, bars, letters, checkers, float32 [side, side]."""
    image = np.full((side, side), rng.uniform(0, 1), np.float32)
    if rng.random() < 0.3:
        cell = int(rng.integers(12, 60))
        rows, columns = np.indices((side, side)) // cell
        image = np.where((rows + columns) % 2 == 0, image, np.float32(rng.uniform(0, 1))).astype(np.float32)
    for _ in range(int(rng.integers(10, 60))):
        shade, place = float(rng.uniform(0, 1)), rng.integers(0, side, 2)
        kind = rng.integers(0, 4)
        if kind == 0:
            corners = place + rng.integers(-70, 70, (int(rng.integers(3, 7)), 2))
            cv2.fillPoly(image, [corners.astype(np.int32)], shade, cv2.LINE_AA)
        elif kind == 1:
            end = place + rng.integers(-250, 250, 2)
            cv2.line(image, place.tolist(), end.tolist(), shade, int(rng.integers(1, 9)), cv2.LINE_AA)
        elif kind == 2:
            word = "".join(rng.choice(list("ABCDEFGHKLMNPRSTUVXYZ0123456789"), int(rng.integers(1, 9))))
            cv2.putText(image, word, place.tolist(), cv2.FONT_HERSHEY_SIMPLEX, float(rng.uniform(0.5, 3)), shade,
                        int(rng.integers(1, 6)), cv2.LINE_AA)
        else:
            cv2.circle(image, place.tolist(), int(rng.integers(3, 60)), shade, -1, cv2.LINE_AA)
    return image


def random_mask(rng, size):
    """Random shape in the middle of a black canvas, float32 [2 H, 2 W]."""
    mask = np.zeros((2 * size[0], 2 * size[1]), np.float32)
    centre = np.array([size[1], size[0]])
    kind = rng.random()
    if kind < 0.45:
        corners = rng.integers(3, 10)
        angle = np.sort(rng.uniform(0, 2 * np.pi, corners))
        radius = min(size) * rng.uniform(0.1, 0.45, corners)
        outline = centre + np.stack([radius * np.cos(angle), radius * np.sin(angle)], 1)
        cv2.fillPoly(mask, [outline.astype(np.int32)], 1.0, cv2.LINE_AA)
    elif kind < 0.8:
        axes = (min(size) * rng.uniform(0.05, 0.4, 2)).astype(int).tolist()
        cv2.ellipse(mask, centre.tolist(), axes, float(rng.uniform(0, 180)), 0, 360, 1.0, -1, cv2.LINE_AA)
    else:               # a bar
        half = min(size) * rng.uniform(0.2, 0.8) * np.array([np.cos(a := rng.uniform(0, np.pi)), np.sin(a)])
        cv2.line(mask, (centre - half).astype(int).tolist(), (centre + half).astype(int).tolist(), 1.0,
                 int(rng.integers(2, 14)), cv2.LINE_AA)
    return mask


class World:
    """A background and the objects before it; `gain` may vary with time and exceed the white level."""

    def __init__(self, rng, photos, size, travel, standing=False):
        self.size, self.standing = size, standing
        for _ in range(CONTENT_DRAWS):
            self._compose(rng, photos, travel)
            if self._has_content():
                break

    def _compose(self, rng, photos, travel):
        size = self.size
        self.background = self._surface(rng, photos, Motion(rng, size, 0 if self.standing else travel), 0.1)
        self.objects = []
        count = int(rng.choice(4, p=(0.6, 0.2, 0.12, 0.08)))
        for _ in range(max(count, 1) if self.standing else count):
            motion = Motion(rng, size, rng.uniform(2, max(1.2 * travel, 12)))
            surface = self._surface(rng, photos, motion, 0.3)
            mask = random_mask(rng, size)
            centre = np.array(size[::-1]) * rng.uniform(0.65, 1.35, 2)
            cutout = Surface(mask, size, motion, 1.0, centre, cv2.BORDER_CONSTANT)
            self.objects.append((surface, cutout))
        self.gain, self.offset, self.ramp = 1.0, 0.0, 0.0
        kind = rng.random()
        if kind < 0.35:
            self.gain, self.offset = rng.uniform(0.25, 1.0), rng.uniform(0, 0.05)
        elif kind < 0.5:
            self.gain = rng.uniform(1.0, 1.5)   # the brightest parts saturate the frame
        if rng.random() < 0.06:
            self.ramp = rng.uniform(-0.15, 0.15)    # brightness changes during the exposure

    def _has_content(self):
        """Whether there is something to see: a view of clear sky or one that is white throughout has no motion."""
        frame = self.render(0.0)
        return frame.clip(0, 1).std() >= LEAST_CONTRAST and (frame >= 1).mean() <= MOST_WHITE

    def _surface(self, rng, photos, motion, graphics):
        texture = random_graphics(rng) if rng.random() < graphics else photos[rng.integers(len(photos))]
        room = min(texture.shape) / (max(self.size) + 0.5 * min(motion.travel(), 40))
        zoom = rng.uniform(1.0, np.clip(room, 1.0, 2.6))
        if rng.random() < 0.2:      # out of focus
            texture = cv2.GaussianBlur(texture, (0, 0), rng.uniform(0.5, 2.5) * zoom)
        return Surface(texture, self.size, motion, zoom, random_origin(rng, texture, self.size, motion, zoom))

    def render(self, time):
        """Sharp radiance at a normalised time, float32 [H, W]; beyond 1 where the frame saturates."""
        frame = self.background.render(time)
        for surface, cutout in self.objects:
            alpha = cutout.render(time)
            frame = frame + alpha * (surface.render(time) - frame)
        return (self.gain * (1 + self.ramp * time)) * frame + np.float32(self.offset)

    def travel(self):
        """Length of the path of the background's translation, pixels."""
        return self.background.motion.travel()

    def fastest(self):
        return max([self.travel()] + [surface.motion.travel() for surface, _ in self.objects])

    def velocity(self, time, stride):
        """Velocity of what is visible, float32 [2, H / stride, W / stride] (x, y), pixels a unit of
        normalised time, at the centres of stride x stride blocks."""
        height, width = (side // stride for side in self.size)
        centre = np.array([[(self.size[1] - 1) / 2], [(self.size[0] - 1) / 2]])
        rows, columns = np.indices((height, width)) * stride + (stride - 1) / 2
        points = np.stack([columns.ravel(), rows.ravel()]) - centre
        field = self.background.motion.velocity(time, points)
        for surface, cutout in self.objects:
            alpha = cv2.resize(cutout.render(time)[:height * stride, :width * stride], (width, height),
                               interpolation=cv2.INTER_AREA).ravel()
            field = np.where(alpha > 0.5, surface.motion.velocity(time, points), field)
        return field.reshape(2, height, width).astype(np.float32)
