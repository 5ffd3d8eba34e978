"""Model of an event camera: ESIM with the faults of real sensors, and its frame readout."""
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Sensor:
    """Faults are off by default. Times in microseconds, thresholds in ln(I + log_eps)."""
    positive: float = 0.18          # mean contrast threshold of brighter
    negative: float = 0.18          # and of darker
    sigma: float = 0.03             # of each threshold, drawn anew after every event
    pixel_spread: float = 0.0       # relative, fixed for a pixel, both signs apart
    log_eps: float = 0.01
    warm: bool = True               # ran before the exposure: levels start anywhere within a threshold
    refractory_us: float = 0.0      # a pixel is blind for so long after an event
    bandwidth_us: float = 0.0       # time constant of the photoreceptor at I = 1, longer in the dark
    late_us: float = 0.0            # events' clock behind the frame's
    noise_hz: float = 0.0           # background events a pixel and second
    hot: float = 0.0                # share of pixels that fire by themselves at 100 to 2000 Hz
    lost: float = 0.0               # share of events that the bus drops
    frame_noise: float = 0.0        # standard deviation of the frame, [0, 1] scale, at I = 0.5
    drift: float | None = None      # change of the light from mid-exposure to its end; None: the world's own

    @staticmethod
    def evaluation(rng):
        """Sensor of the benchmark's scenes: unknown thresholds, 0.12 to 0.35, in steady light, with the
        faults that every event camera has, each small."""
        base, apart = rng.uniform(0.12, 0.35), rng.uniform(1 / 1.1, 1.1)
        return Sensor(positive=base * apart, negative=base / apart, warm=bool(rng.random() < 0.5), drift=0.0,
                      pixel_spread=rng.uniform(0, 0.1), noise_hz=np.exp(rng.uniform(np.log(0.03), np.log(0.3))),
                      hot=1e-4, refractory_us=100.0, bandwidth_us=rng.uniform(0, 200),
                      frame_noise=rng.uniform(0, 1 / 255))

    @staticmethod
    def training(rng):
        """Any sensor: half of them close to ESIM, half with several faults at once."""
        base = np.exp(rng.uniform(np.log(0.1), np.log(0.5))) if rng.random() < 0.4 else rng.uniform(0.12, 0.35)
        apart = np.exp(np.clip(rng.normal(0, 0.07), -0.2, 0.2))
        common = dict(positive=base * apart, negative=base / apart, warm=bool(rng.random() < 0.6),
                      frame_noise=rng.uniform(0, 1.5 / 255) if rng.random() < 0.4 else 0.0)
        if rng.random() < 0.5:
            return Sensor(refractory_us=rng.choice([0.0, 100.0]), noise_hz=rng.choice([0.0, 0.1]), **common)

        def sometimes(chance, low, high):
            return rng.uniform(low, high) if rng.random() < chance else 0.0
        return Sensor(sigma=rng.uniform(0, 0.05), pixel_spread=sometimes(0.7, 0, 0.15),
                      log_eps=np.exp(rng.uniform(np.log(0.003), np.log(0.03))),
                      refractory_us=sometimes(0.6, 0, 1000), bandwidth_us=sometimes(0.5, 0, 1000),
                      late_us=sometimes(0.2, 0, 2500), noise_hz=sometimes(0.6, 0, 3), hot=sometimes(0.4, 0, 5e-4),
                      lost=sometimes(0.3, 0, 0.3), **common)

    def events(self, rng, frames, times_us):
        """Sorted t (int64), x, y, p (0/1) for an iterable of radiance frames [H, W] and their times.

        Crossings are interpolated linearly between frames; times end at the last frame's.
        """
        found, state, previous, before = [], None, None, None
        for frame, now in zip(frames, times_us):
            signal = np.log(frame.ravel() + np.float32(self.log_eps))
            if state is None:
                state, previous, before, begin, shape = _Pixels(self, rng, signal), signal, now, now, frame.shape
                continue
            if self.bandwidth_us > 0:
                constant = self.bandwidth_us / np.maximum(frame.ravel(), 0.05)
                signal = previous + (1 - np.exp((before - now) / constant)) * (signal - previous)
            state.cross(previous, signal, before, now, found)
            previous, before = signal, now
        pixels, span = previous.size, before - begin
        self._faults(rng, pixels, begin, span, found)
        t, index, p = (np.concatenate(part) for part in zip(*found))
        t = np.round(t + self.late_us).astype(np.int64)
        keep = t <= before
        if self.lost > 0:
            keep &= rng.random(t.size) >= self.lost
        t, index, p = t[keep], index[keep], p[keep]
        order = np.argsort(t, kind="stable")
        index = index[order]
        return t[order], index % shape[1], index // shape[1], p[order].astype(np.int64)

    def _faults(self, rng, pixels, begin, span, found):
        """Events that no change of brightness caused."""
        count = rng.poisson(self.noise_hz * 1e-6 * span * pixels)
        found.append((begin + rng.uniform(0, span, count), rng.integers(0, pixels, count), rng.random(count) < 0.5))
        for pixel in np.flatnonzero(rng.random(pixels) < self.hot) if self.hot > 0 else ():
            count = rng.poisson(np.exp(rng.uniform(np.log(100), np.log(2000))) * 1e-6 * span)
            found.append((begin + rng.uniform(0, span, count), np.full(count, pixel),
                          rng.random(count) < rng.choice([0.1, 0.5, 0.9])))

    def frame(self, rng, radiance):
        """What the frame readout gives: noise (photon noise grows with the root of I), clipped, 8 bits."""
        if self.frame_noise > 0:
            scale = self.frame_noise * np.sqrt(0.5 + np.clip(radiance, 0, 1))
            radiance = radiance + rng.normal(0, 1, radiance.shape) * scale
        return np.clip(np.round(radiance * 255), 0, 255).astype(np.uint8)


class _Pixels:
    """Reference level, next thresholds and last event of each pixel."""

    def __init__(self, sensor, rng, signal):
        self.sensor, self.rng = sensor, rng
        spread = rng.normal(1, sensor.pixel_spread, (2, signal.size)).clip(0.5, 2).astype(np.float32)
        self.mean_up, self.mean_down = sensor.positive * spread[0], sensor.negative * spread[1]
        self.up, self.down = self._draw(self.mean_up), self._draw(self.mean_down)
        self.level = signal.copy()
        if sensor.warm:
            self.level += rng.uniform(-self.up, self.down).astype(np.float32)
        self.last = np.full(signal.size, -np.inf)

    def _draw(self, mean):
        noise = self.rng.standard_normal(mean.size, np.float32)
        return np.maximum(mean + np.float32(self.sensor.sigma) * noise, np.float32(0.02))

    def cross(self, previous, signal, before, now, found):
        """Appends (time, pixel, rising) of every threshold crossed between two moments."""
        change = signal - self.level
        active = np.flatnonzero((change >= self.up) | (change <= -self.down))
        while active.size:
            change = signal[active] - self.level[active]
            rising = change > 0
            step = np.where(rising, self.up[active], -self.down[active])
            hit = np.abs(change) >= np.abs(step)
            active, rising, step = active[hit], rising[hit], step[hit]
            self.level[active] += step
            slope = signal[active] - previous[active]
            share = np.divide(self.level[active] - previous[active], slope, out=np.ones_like(slope),
                              where=slope != 0)
            when = before + np.clip(share, 0, 1) * (now - before)
            if self.sensor.refractory_us > 0:
                seen = when - self.last[active] >= self.sensor.refractory_us
                self.last[active[seen]] = when[seen]
                found.append((when[seen], active[seen], rising[seen]))
            else:
                found.append((when, active, rising))
            self.up[active] = self._draw(self.mean_up[active])
            self.down[active] = self._draw(self.mean_down[active])
