"""Unit tests of eSL-Net: /usr/bin/python3 -m unittest test_esl_net (from tools/train).

With ECIR_TOOL, the path of the built `ecir`, and the published weights under ECIR_TEST_RECORDINGS
(as in tools/test), also the whole program against PyTorch.
"""
import os
import subprocess
import sys
import tempfile
import unittest

import cv2
import numpy as np
import torch

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, HERE)

import esl_net
import export
import make_fixtures

torch.set_num_threads(1)
PUBLISHED = os.path.join(os.environ.get("ECIR_TEST_RECORDINGS", ""), "weights", "esl_net_withoutsr.npz")


def import_weights(*arguments):
    return subprocess.run([sys.executable, os.path.join(HERE, "import_esl_net.py"), *arguments],
                          capture_output=True, text=True)


class Counts(unittest.TestCase):
    def channels(self, t, p, time, start=0, end=2000):
        zero = np.zeros(len(t), int)
        counts = esl_net.outward_counts(np.array(t), zero, zero, np.array(p), start, end, time, (1, 1))
        return {int(c): int(counts[c, 0, 0]) for c in np.flatnonzero(counts[:, 0, 0])}

    def test_events_before_the_instant_change_sign(self):
        self.assertEqual(self.channels([850, 950, 1050, 1150], [1, 0, 1, 0], 0.0), {0: 2, 3: 2})

    def test_edges(self):
        # At 1000: the instant itself is after it; bins are 100 wide, the nearer end included.
        self.assertEqual(self.channels([899, 900, 901, 999, 1000, 1099, 1100], [1] * 7, 0.0),
                         {1: 2, 3: 2, 0: 2, 2: 1})
        self.assertEqual(self.channels([0, 99, 100, 1999, 2000], [1] * 5, -1.0), {0: 2, 2: 1, 38: 2})
        self.assertEqual(self.channels([0, 1, 1900, 1901, 2000], [1] * 5, 1.0), {39: 2, 3: 1, 1: 1, 0: 1})

    def test_every_edge_is_exact_at_large_times(self):
        start = 1615007563376030
        end = start + 26 * 5200
        for frame in range(14):
            time = -1 + 2 * frame / 13
            instant = start + frame * 10400
            self.assertEqual(esl_net.frame_instant(time, start, end), (instant - start) * 1024)
            for k in range(1, 20):
                for t in (instant - k * 6760, instant + k * 6760):
                    if start <= t <= end:
                        self.assertEqual(self.channels([t], [1], time, start, end),
                                         {2 * k + (t < instant): 1})


class Network(unittest.TestCase):
    def test_published_names_and_count(self):
        state = esl_net.EslNet().state_dict()
        self.assertEqual(sum(value.numel() for value in state.values()), 187920)
        self.assertEqual(sorted(state), sorted(
            ["image_d.weight", "event_c1.weight", "event_c2.weight", "scn.0.W1.weight", "scn.0.S1.weight",
             "scn.0.S2.weight", "W2.weight", "endconv.weight"]))

    def test_proportional_to_the_frame(self):
        net = esl_net.EslNet().double().eval()
        blurry = torch.rand(1, 1, 17, 23, dtype=torch.float64)
        counts = torch.randint(0, 5, (1, 40, 17, 23)).double()
        with torch.no_grad():
            frame, scaled = net(blurry, counts), net(255 * blurry, counts)
        self.assertEqual(frame.shape, (1, 1, 17, 23))
        torch.testing.assert_close(scaled, 255 * frame)


class Import(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = folder.name
        self.state = esl_net.EslNet().state_dict()
        self.arrays = {name: value.numpy() for name, value in self.state.items()}

    def path(self, name):
        return os.path.join(self.folder, name)

    def test_npz_and_state_dict(self):
        np.savez(self.path("a.npz"), **self.arrays)
        torch.save({"module." + name: value for name, value in self.state.items()}, self.path("a.pt"))
        for source in ("a.npz", "a.pt"):
            done = import_weights(self.path(source), "-o", self.path("out.safetensors"))
            self.assertEqual(done.returncode, 0, done.stderr)
            tensors, metadata = export.read_safetensors(self.path("out.safetensors"))
            self.assertEqual(metadata["model"], "esl_net")
            self.assertEqual(len(tensors), len(self.arrays))
            again = esl_net.load_esl_net(self.path("out.safetensors")).state_dict()
            for name, value in self.state.items():
                self.assertTrue(torch.equal(again[name], value), name)

    def refused(self, path, *parts):
        done = import_weights(path, "-o", self.path("out.safetensors"))
        self.assertEqual(done.returncode, 1)
        self.assertNotIn("Traceback", done.stderr)
        for part in (os.path.basename(path), *parts):
            self.assertIn(part, done.stderr)
        self.assertFalse(os.path.exists(self.path("out.safetensors")))

    def test_what_does_not_fit_is_named(self):
        def saved(name, **arrays):
            np.savez(self.path(name), **arrays)
            return self.path(name)
        arrays = self.arrays
        self.refused(saved("few.npz", **{k: v for k, v in arrays.items() if k != "W2.weight"}), "W2.weight")
        self.refused(saved("shape.npz", **arrays | {"W2.weight": arrays["scn.0.W1.weight"]}),
                     "W2.weight", "[128, 40, 3, 3]", "[40, 128, 3, 3]")
        self.refused(saved("more.npz", **arrays, other=np.zeros(1)), "'other'")
        self.refused(saved("nan.npz", **arrays | {"W2.weight": arrays["W2.weight"] * np.nan}), "finite")
        whole = saved("whole.npz", **arrays)
        with open(whole, "rb") as source, open(self.path("half.npz"), "wb") as half:
            half.write(source.read()[:300000])
        self.refused(self.path("half.npz"), "neither")
        torch.save([1, 2], self.path("list.pt"))
        self.refused(self.path("list.pt"), "state dict")
        self.refused(self.path("absent.npz"), "No such file")


@unittest.skipUnless("ECIR_TOOL" in os.environ and os.path.isfile(PUBLISHED),
                     "needs ECIR_TOOL and the published weights under ECIR_TEST_RECORDINGS")
class Program(unittest.TestCase):
    def test_agrees_with_pytorch_within_a_50th_of_a_grey_level(self):
        rng = np.random.default_rng(8)
        height, width, end = 47, 61, make_fixtures.EXPOSURE_US
        blurry = np.round(make_fixtures.synthetic_blurry(rng, height, width) * 255)
        t, x, y, p = make_fixtures.synthetic_events(rng, height, width, 6000)
        times = [-1.0, -1 / 3, 0.7]
        with tempfile.TemporaryDirectory() as folder:
            weights, image, events, frames = (os.path.join(folder, name) for name in (
                "weights.safetensors", "blurry.png", "events.txt", "frames.npy"))
            self.assertEqual(import_weights(PUBLISHED, "-o", weights).returncode, 0)
            cv2.imwrite(image, blurry.astype(np.uint8))
            np.savetxt(events, np.stack([t / 1e6, x, y, p], 1), fmt=["%.6f", "%d", "%d", "%d"])
            subprocess.run([os.environ["ECIR_TOOL"], "deblur", "-i", image, "-e", events, "--exposure", "0",
                            str(end), "-o", frames, "-m", weights, "--times", *map(repr, times)], check=True)
            net = esl_net.load_esl_net(weights)
            for time, frame in zip(times, np.load(frames)):
                counts = esl_net.outward_counts(t, x, y, p, 0, end, time, (height, width))
                inputs = [torch.from_numpy(a.astype(np.float32))[None] for a in (blurry[None], counts)]
                with torch.no_grad():
                    expected = net(*inputs)
                self.assertLess(np.abs(255 * frame - expected[0, 0].numpy()).max(), 0.02)


if __name__ == "__main__":
    unittest.main()
