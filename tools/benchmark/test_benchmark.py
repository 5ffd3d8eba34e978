"""Unit tests: python3 -m unittest test_benchmark (from tools/benchmark). ECIR_TOOL=PROGRAM adds a whole small run."""
import json
import os
import subprocess
import sys
import tempfile
import unittest

import cv2
import numpy as np

import paths    # noqa: F401 (before the modules of tools/train)
import charts   # noqa: F401 (chooses matplotlib's back end)
import reference_free as free
import report
from cache import Cache
from cost import multiply_adds
from methods import FRAMES, REFERENCE, Method
from metrics import measure, to_codes
from simulated import BANDS, SceneSpec, best_threshold, summarise


def texture(height=60, width=80, seed=1):
    noise = np.random.default_rng(seed).uniform(0, 1, (height, width))
    return 0.2 + 0.6 * cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2), None, 0, 1, cv2.NORM_MINMAX)


class Metrics(unittest.TestCase):
    def test_codes_are_clipped_and_truncated(self):
        self.assertEqual(to_codes(np.array([-1, 0.999, 0.5, 2])).tolist(), [0, 254, 127, 255])

    def test_constant_difference(self):
        truth = np.full((20, 20), 100, np.uint8)
        psnr, ssim, nrmse = measure(truth + 10, truth)
        self.assertAlmostEqual(psnr, 20 * np.log10(25.5))
        self.assertAlmostEqual(nrmse, 0.1)
        c = (0.01 * 255) ** 2   # constant windows: only the luminance term of SSIM is left
        self.assertAlmostEqual(ssim, (2 * 100 * 110 + c) / (100 ** 2 + 110 ** 2 + c))

    def test_identical_frames(self):
        truth = to_codes(texture())
        self.assertEqual(measure(truth, truth), (np.inf, 1.0, 0.0))


class ReferenceFree(unittest.TestCase):
    def test_reblur_error_is_of_the_trapezoid_mean(self):
        frames = [np.full((4, 4), value) for value in (0.0, 1.0, 0.0)]
        self.assertAlmostEqual(free.reblur_error(frames, np.full((4, 4), 0.5)), 0)
        self.assertAlmostEqual(free.reblur_error(frames, np.full((4, 4), 0.4)), 25.5)

    def test_event_image_counts_signs_within_the_interval(self):
        t, x, y, p = (np.array(row) for row in ([5, 10, 15, 20], [0, 1, 1, 2], [0, 1, 1, 1], [1, 1, 1, 0]))
        np.testing.assert_array_equal(free.event_image(t, x, y, p, 10, 20, (2, 3)), [[0, 0, 0], [0, 2, 0]])
        np.testing.assert_array_equal(free.event_image(t, x, y, p, 20, 21, (2, 3)), [[0, 0, 0], [0, 0, -1]])

    def test_event_agreement(self):
        before = texture()
        count = np.random.default_rng(2).integers(-3, 4, before.shape).astype(float)
        after = np.exp(np.log(before + free.LOG_EPS) + 0.2 * count) - free.LOG_EPS
        self.assertAlmostEqual(free.event_agreement(before, after, count), 1)
        self.assertAlmostEqual(free.event_agreement(after, before, count), -1)
        self.assertLess(abs(free.event_agreement(before, after, count[::-1])), 0.1)
        self.assertIsNone(free.event_agreement(before, before, count))

    def test_ghost_error_ignores_a_translation_and_sees_a_ghost(self):
        large = texture(100, 120)
        last = large[10:90, 10:110]
        moved = cv2.warpAffine(large, np.array([[1, 0, 2.5], [0, 1, -1.5]]), large.shape[::-1],
                               flags=cv2.INTER_CUBIC)[10:90, 10:110]
        self.assertLess(free.ghost_error(last, moved), 1)
        self.assertGreater(free.ghost_error(last, moved + 0.3 * np.roll(texture(80, 100, 5), 9, 1)), 5)

    def test_blur_lowers_the_gradient(self):
        self.assertLess(free.gradient(cv2.GaussianBlur(texture(), (0, 0), 3)), 0.8 * free.gradient(texture()))


class Tables(unittest.TestCase):
    def test_markdown(self):
        self.assertEqual(report.table(["a", "b"], [["x", "1"]]), "| a | b |\n| --- | ---: |\n| x | 1 |\n")
        self.assertEqual([report.number(None), report.number(1.005, 1), report.number(2, 2, True)],
                         ["–", "1.0", "+2.00"])

    def test_summary_has_margins_and_spread(self):
        methods = [Method(REFERENCE, "EDI", "edi"), Method("fusion", "fusion", "fusion"),
                   Method("esl-net", "eSL-Net", "esl_net", slow=True)]
        def scene(shift):
            return {REFERENCE: {"frames": [[30 + shift, 0.8, 0.1]] * FRAMES},
                    "fusion": {"frames": [[34 + shift + i, 0.9, 0.05] for i in range(FRAMES)]}}
        row = summarise([scene(0), scene(2)], methods)
        self.assertEqual(set(row), {REFERENCE, "fusion"})     # eSL-Net has no results on these scenes
        self.assertAlmostEqual(row["fusion"]["margin_psnr"], 4 + (FRAMES - 1) / 2)
        self.assertAlmostEqual(row["fusion"]["margin_psnr_sd"], 0)
        self.assertAlmostEqual(row["fusion"]["psnr_sd"], 1)
        few = summarise([scene(0)], methods, frames=(0, 2))
        self.assertAlmostEqual(few["fusion"]["psnr"], 35)

    def test_multiply_adds(self):
        shapes = {"esl.scn.0.S1.weight": [40, 128, 3, 3], "esl.W2.weight": [40, 128, 3, 3], "esl.bias": [7]}
        self.assertEqual(multiply_adds({"model": "esl_net"}, shapes, (3, 5), 2), 26 * 40 * 128 * 9 * 15 * 2)
        halved = {"unet.en_conv1.0.weight": [2, 3, 5, 5]}
        self.assertEqual(multiply_adds({"model": "ecir"}, halved, (5, 7), 14), 150 * 3 * 4)


class Search(unittest.TestCase):
    def test_finds_the_peak(self):
        for peak in (0.08, 0.213, 0.4):
            threshold, score = best_threshold(lambda c, peak=peak: -np.log(c / peak) ** 2)
            self.assertLess(abs(np.log(threshold / peak)), 0.015)
            self.assertLessEqual(score, 0)

    def test_travel_stays_within_the_band_and_spreads(self):
        for band, (low, high) in enumerate(BANDS):
            travel = [SceneSpec(1, band, number, (16, 16)).travel() for number in range(7)]
            np.testing.assert_allclose(np.diff(sorted(travel)), (high - low) / 8)
            self.assertAlmostEqual(travel[0], (low + high) / 2)

    def test_cache(self):
        with tempfile.TemporaryDirectory() as folder:
            cache = Cache(folder)
            self.assertIsNone(cache.get({"a": [1]}))
            cache.put({"a": [1]}, {"x": 2})
            self.assertEqual(Cache(folder).get({"a": (1,)}), {"x": 2})
            self.assertIsNone(cache.get({"a": [2]}))


@unittest.skipUnless(os.environ.get("ECIR_TOOL"), "needs ECIR_TOOL")
class WholeRun(unittest.TestCase):
    def test_small(self):
        here = os.path.dirname(os.path.abspath(__file__))
        with tempfile.TemporaryDirectory() as folder:
            for seed in (1, 2):
                cv2.imwrite(os.path.join(folder, f"{seed}.png"), to_codes(texture(200, 200, seed)))
            capture = os.path.join(here, "..", "sample", "scene")
            command = [sys.executable, "-B", os.path.join(here, "run"), "--ecir", os.environ["ECIR_TOOL"],
                       "--images", folder, "-o", os.path.join(folder, "out"), "--scenes", "1",
                       "--sections", "accuracy", "captures", "--models", "--captures", capture,
                       "--size", "40x32", "--jobs", "1"]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            self.assertEqual(done.returncode, 0, done.stderr)
            with open(os.path.join(folder, "out", "results.json"), encoding="utf-8") as file:
                results = json.load(file)
            methods = results["accuracy"][-1]["methods"]
            self.assertGreater(methods[REFERENCE]["psnr"] + 1, methods["edi"]["psnr"])   # which has two thresholds
            self.assertGreater(methods["edi"]["psnr"], methods["blurry"]["psnr"])
            edi = results["captures"]["scene"]["edi"]["all"]
            self.assertLess(edi["reblur"], 1)
            self.assertGreater(edi["agreement"], 0.7)
            for name in ("report.md", "accuracy.png", "accuracy.svg", "captures/scene.png"):
                self.assertTrue(os.path.exists(os.path.join(folder, "out", name)), name)


if __name__ == "__main__":
    unittest.main()
