"""Accuracy on simulated scenes: by travel, and under the faults of a sensor."""
import glob
import os
import tempfile
from dataclasses import dataclass, replace

import numpy as np

import paths
from cache import file_hash
from methods import FRAMES, REFERENCE
from metrics import measure, psnr, to_codes
from scenes import load_photos
from sensor import Sensor
from simulate import make_scene, write_recording

BANDS = ((4, 15), (15, 30), (30, 60), (60, 90))     # travel, pixels an exposure
ASSUMED = 0.2       # threshold that is told, and that the networks without this input were trained around


@dataclass(frozen=True)
class Condition:
    """A sensor that differs from the nominal one; given: thresholds told to the methods that take them."""
    name: str
    label: str
    changes: tuple = ()
    given: float = 0.0


def _thresholds(factor):
    return ("positive", factor * ASSUMED), ("negative", factor * ASSUMED)


NOMINAL = Condition("nominal", "nominal: small faults of every kind")
FAULTLESS = tuple((name, 0.0) for name in
                  ("pixel_spread", "noise_hz", "hot", "refractory_us", "bandwidth_us", "frame_noise"))
CONDITIONS = (
    NOMINAL,
    Condition("faultless", "plain ESIM, without faults", FAULTLESS),
    Condition("low-told", f"thresholds {0.7 * ASSUMED:.2f}, told {ASSUMED:.2f}", _thresholds(0.7), ASSUMED),
    Condition("high-told", f"thresholds {1.3 * ASSUMED:.2f}, told {ASSUMED:.2f}", _thresholds(1.3), ASSUMED),
    Condition("low", f"thresholds {0.7 * ASSUMED:.2f}", _thresholds(0.7)),
    Condition("high", f"thresholds {1.3 * ASSUMED:.2f}", _thresholds(1.3)),
    Condition("noise-1", "background noise, 1 Hz a pixel", (("noise_hz", 1.0),)),
    Condition("noise-5", "background noise, 5 Hz a pixel", (("noise_hz", 5.0),)),
    Condition("hot", "hot pixels, 0.1 %", (("hot", 0.001),)),
    Condition("lost", "a quarter of the events lost", (("lost", 0.25),)),
    Condition("spread", "thresholds vary by 10 % from pixel to pixel", (("pixel_spread", 0.1),)),
    Condition("bandwidth", "photoreceptor of 0.5 ms at white, slower in the dark", (("bandwidth_us", 500.0),)),
    Condition("drift", "light that grows by a fifth during the exposure", (("drift", 0.1),)),
    Condition("frame-noise", "noise of the frame, 2 grey levels", (("frame_noise", 2 / 255),)),
)


@dataclass(frozen=True)
class SceneSpec:
    seed: int
    band: int
    number: int             # in its band
    size: tuple             # (H, W)
    condition: Condition = NOMINAL

    def travel(self):
        """Evenly spread over the band whatever the number of scenes: radical inverse in base 2."""
        low, high = BANDS[self.band]
        share, bit, rest = 0.0, 0.5, self.number + 1
        while rest:
            share += bit * (rest % 2)
            bit, rest = bit / 2, rest // 2
        return low + (high - low) * share

    def make(self, photos):
        def sensor(rng):
            return replace(Sensor.evaluation(rng), **dict(self.condition.changes))
        return make_scene(photos, self.seed, 1000 * self.band + self.number, self.size, self.travel(), sensor=sensor)

    def identity(self):
        """condition.given belongs to the methods that take it."""
        return {"seed": self.seed, "band": BANDS[self.band], "number": self.number, "size": self.size,
                "changes": self.condition.changes}


class Simulation:
    """Photographs and code that scenes are made from."""

    def __init__(self, images):
        self.photos = load_photos(images)
        code = [os.path.join(paths.TRAIN, name) for name in ("simulate.py", "scenes.py", "sensor.py", "metrics.py")]
        self.hash = file_hash(
            *code, *sorted(filter(os.path.isfile, glob.glob(os.path.join(images, "*")))))


def best_threshold(score):
    """(threshold, score) of the highest score: steps of 20 %, then 6 %, then 2 % around the best."""
    known, wanted = {}, [0.07 * 1.2 ** k for k in range(12)]
    for step in (1.2 ** (1 / 3), 1.2 ** (1 / 9), None):
        known.update((c, score(c)) for c in wanted)
        best = max(known, key=known.get)
        wanted = [best * step ** k for k in (-2, -1, 1, 2)] if step else []
    return best, known[best]


def _frames(ecir, method, scene, recording, given):
    """8-bit frames of a method, and the threshold that was searched for or given."""
    if method.architecture == "blurry":
        return [scene.blurry] * FRAMES, None
    if method.name == REFERENCE:
        def score(threshold):
            return np.mean([psnr(frame, truth) for frame, truth in zip(render(threshold), scene.truth)])

        def render(threshold):
            return to_codes(ecir.deblur(recording, method, "--frames", FRAMES, "--threshold", threshold))
        threshold, _ = best_threshold(score)
        return render(threshold), threshold
    when = ["--frames", FRAMES]
    if method.slow:
        when = ["--times", *np.linspace(-1, 1, FRAMES)[list(method.frames)]]
    threshold = ["--threshold", given] if given and method.takes_threshold else []
    return to_codes(ecir.deblur(recording, method, *when, *threshold)), given if threshold else None


def evaluate_scene(ecir, cache, simulation, spec, methods):
    """{method: {"frames": [[psnr, ssim, nrmse], ...] of method.frames, "threshold"}}."""
    results, scene = {}, None
    with tempfile.TemporaryDirectory() as folder:
        for method in methods:
            given = spec.condition.given if method.takes_threshold else 0.0
            key = {"scene": spec.identity(), "simulation": simulation.hash, "given": given,
                   "method": method.identity(ecir)}
            found = cache.get(key)
            if found is None:
                if scene is None:
                    scene = spec.make(simulation.photos)
                    write_recording(scene, folder)
                frames, threshold = _frames(ecir, method, scene, folder, given)
                truth = scene.truth[list(method.frames)]
                found = {"frames": [list(map(float, measure(*pair))) for pair in zip(frames, truth)],
                         "threshold": threshold}
                cache.put(key, found)
            results[method.name] = found
    return results


def accuracy_tasks(seed, scenes, few, size, methods):
    """(spec, methods) by band; slow methods on the first `few` scenes of each."""
    fast = [method for method in methods if not method.slow]
    return [(SceneSpec(seed, band, number, size), methods if number < few else fast)
            for band in range(len(BANDS)) for number in range(scenes)]


def robustness_tasks(seed, scenes, few, size, methods):
    """The first scenes of the accuracy table under each condition; a search for the best threshold is
    left out, slow methods see `few` scenes of all bands together."""
    tasks, turn = [], (0, 2, 1, 3)  # few scenes are spread over the bands
    for condition in CONDITIONS:
        for band in range(len(BANDS)):
            for number in range(scenes):
                chosen = [method for method in methods if method.name != REFERENCE
                          and (not method.slow or number * len(BANDS) + turn[band] < few)]
                tasks.append((SceneSpec(seed, band, number, size, condition), chosen))
    return tasks


def summarise(results, methods, frames=None, reference=REFERENCE):
    """Mean over scenes and spread (standard deviation over scenes) of each method's figures, and of the
    margins over the reference. results: of evaluate_scene; frames: a choice of the FRAMES."""
    def table(method):
        """[scenes, (psnr, ssim, nrmse)], means over frames."""
        chosen = frames if frames is not None else method.frames
        index = [method.frames.index(frame) for frame in chosen]
        return np.array([np.mean(np.array(scene[method.name]["frames"])[index], 0) for scene in results])

    methods = [method for method in methods if all(method.name in scene for scene in results)]
    base = next((table(method) for method in methods if method.name == reference), None)
    summary = {}
    for method in methods:
        figures = table(method)
        row = {"scenes": len(figures)}
        for i, name in enumerate(("psnr", "ssim", "nrmse")):
            row[name], row[name + "_sd"] = float(figures[:, i].mean()), float(figures[:, i].std())
            if base is not None:
                margin = figures[:, i] - base[:, i]
                row["margin_" + name], row[f"margin_{name}_sd"] = float(margin.mean()), float(margin.std())
        summary[method.name] = row
    return summary


def accuracy_rows(tasks, results, methods):
    """[{"band", "methods": summary}] by band and for all, of every frame and of FEW_FRAMES with slow methods."""
    fast, slow = [m for m in methods if not m.slow], [m for m in methods if m.slow]
    every, few = [], []
    for band in [*range(len(BANDS)), None]:
        name = "{}-{}".format(*BANDS[band]) if band is not None else "all"
        chosen = [(result, used) for (spec, used), result in zip(tasks, results) if band in (spec.band, None)]
        every.append({"band": name, "methods": summarise([result for result, _ in chosen], fast)})
        both = [result for result, used in chosen if any(method.slow for method in used)]
        if slow and both:
            few.append({"band": name, "methods": summarise(both, methods, slow[0].frames)})
    return every, few


def robustness_rows(tasks, results, methods, flagship):
    """[{"condition", "label", "methods", "few", "below_edi"}]; few: slow methods' scenes and frames."""
    rows = []
    for condition in CONDITIONS:
        chosen = [(result, used) for (spec, used), result in zip(tasks, results) if spec.condition == condition]
        summary = summarise([result for result, _ in chosen], [m for m in methods if not m.slow], reference="edi")
        row = {"condition": condition.name, "label": condition.label, "told": condition.given or None,
               "methods": summary, "few": {}}
        both = [result for result, used in chosen if any(method.slow for method in used)]
        if both:
            frames = next(method.frames for method in methods if method.slow)
            row["few"] = summarise(both, methods, frames, reference="edi")
        ours, edi = summary.get(flagship), summary.get("edi")
        row["below_edi"] = bool(ours and edi and (ours["psnr"] < edi["psnr"] or ours["ssim"] < edi["ssim"]))
        rows.append(row)
    return rows
