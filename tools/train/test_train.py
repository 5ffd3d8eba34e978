"""Unit tests: /usr/bin/python3 -m unittest test_train (from tools/train)."""
import os
import subprocess
import sys
import tempfile
import unittest

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from skimage.metrics import structural_similarity

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, HERE)

import events
import export
import model as m
import fusion
import motion
import pack
import prior
import scenes
import simulate
import task_ecir
import task_fusion
import video
from sensor import Sensor

torch.set_num_threads(1)


class Curve(unittest.TestCase):
    def setUp(self):
        rng = np.random.default_rng(3)
        self.n = 10
        self.points = np.sort(m.pivots(self.n)[:, None, None] + rng.uniform(-.08, .08, (self.n, 3, 2)), 0).clip(-1, 1)
        self.coefficients = rng.normal(0, 1, (self.n, 3, 2))     # of dL/dt, Chebyshev series
        cheb = np.polynomial.chebyshev
        basis = cheb.chebvander(self.points, self.n - 1)
        self.derivative = np.einsum("nhwk,khw->nhw", basis, self.coefficients)
        self.times = np.linspace(-1, 1, 201)

    def frames(self, times, variant=m.RELEASE):
        values = m.derivative_at_nodes(torch.tensor(self.derivative)[None], torch.tensor(self.points)[None], variant)
        blurry = torch.full((1, 1, 3, 2), 0.4, dtype=torch.float64)
        return m.render(blurry, values, m.frame_matrix(times, self.n))[0].numpy()

    def test_equals_the_integrated_polynomial(self):
        cheb = np.polynomial.chebyshev
        primitive = cheb.chebint(self.coefficients, lbnd=-1)
        second = cheb.chebint(primitive, lbnd=-1)
        mean = cheb.chebval(1.0, second) / 2
        expected = cheb.chebval(self.times, primitive).transpose(2, 0, 1) - mean + 0.4
        np.testing.assert_allclose(self.frames(self.times), expected, atol=1e-10)

    def test_mean_is_the_blurry_frame(self):
        nodes, weights = np.polynomial.legendre.leggauss(12)
        for variant in (m.PAPER, m.RELEASE):
            mean = np.tensordot(weights, self.frames(nodes, variant), 1) / 2
            np.testing.assert_allclose(mean, 0.4, atol=1e-12)

    def test_spread_keypoints(self):
        delta = 2.0 / 9 / 16
        t = m.pivots(10).copy()
        t[4] = t[3] + 1e-6
        t[8] = t[9] = 1.0
        s = m.spread_keypoints(torch.tensor(t).view(1, -1, 1, 1)).numpy().ravel()
        self.assertGreaterEqual(np.diff(s).min(), delta - 1e-12)
        self.assertEqual(s[-1], 1.0)
        self.assertAlmostEqual(s[8], 1.0 - delta, 12)
        np.testing.assert_array_equal(s[[0, 1, 2, 3, 5, 6, 7]], t[[0, 1, 2, 3, 5, 6, 7]])


class Networks(unittest.TestCase):
    def test_parameter_counts_of_the_published_networks(self):
        with torch.no_grad():
            model = m.ECIR(m.RELEASE, 64, 26)
        count = [sum(p.numel() for p in part.parameters()) for part in (model.unet, model.refine)]
        self.assertEqual(count, [19230140, 6058])

    def test_transposed_convolution_equals_torch(self):
        up, x = m._Up(6, 4), torch.rand(2, 6, 5, 7)
        for size in ((9, 13), (10, 14), (9, 14)):
            expected = up[0](x, output_size=list(size)).clamp(min=0)
            self.assertTrue(torch.allclose(up(x, size), expected, atol=1e-5))

    def test_any_size_and_one_frame(self):
        model = m.ECIR(width=4, bins=6, n=3).eval()
        for size in ((16, 16), (17, 31), (23, 16)):
            with torch.no_grad():
                initial, refined = model(torch.rand(1, 1, *size), torch.rand(1, 6, *size),
                                         torch.tensor(m.pivots(3)).float().view(1, 3, 1, 1).expand(1, 3, *size),
                                         [0.0], torch.zeros(1, 0, *size))
            self.assertEqual(initial.shape, (1, 1) + size)
            self.assertEqual(refined.shape, (1, 1) + size)


class Histogram(unittest.TestCase):
    def counts(self, t, p, variant, edges, start=0, end=100):
        tau = events.normalise(np.array(t), start, end)
        zero = np.zeros(len(t), int)
        return events.histogram(tau, zero, zero, np.array(p), edges, (1, 1), variant)[:, 0, 0].tolist()

    def test_paper_is_half_open_and_closed_at_the_end(self):
        edges = events.unet_edges(m.PAPER, 8)
        self.assertEqual(self.counts([0, 25, 50, 75, 100, 100], [1, 1, 0, 1, 0, 1], m.PAPER, edges),
                         [1, 0, 1, 0, 0, 1, 2, 1])

    def test_every_edge_is_exact_at_large_times(self):
        start, end = 1615007563376030, 1615007563376030 + 104000
        edges = events.unet_edges(m.PAPER, 40)
        t = start + np.arange(20, dtype=np.int64) * 5200
        tau = events.normalise(t, start, end)
        zero = np.zeros(20, int)
        counts = events.histogram(tau, zero, zero, zero + 1, edges, (1, 1), m.PAPER)[:, 0, 0]
        np.testing.assert_array_equal(counts, [1, 0] * 20)

    def test_release_is_closed_and_drops_the_latest_time(self):
        edges = [-1.0, 0.0, 1.0]
        # [0, 50]: the two at 50 go; [50, 100]: the one at 100 goes, those at 50 stay.
        self.assertEqual(self.counts([0, 10, 50, 50, 100], [1, 0, 1, 1, 1], m.RELEASE, edges), [1, 1, 2, 0])
        self.assertEqual(self.counts([10, 10], [1, 1], m.RELEASE, edges), [0, 0, 0, 0])


class Keypoints(unittest.TestCase):
    def points(self, t, variant=m.PAPER, n=3, start=0, end=100):
        zero = np.zeros(len(t), int)
        return events.keypoints(np.array(t, np.int64), zero, zero, start, end, n, (1, 1), variant)[:, 0, 0]

    def test_nearest_event_of_the_cell(self):
        np.testing.assert_allclose(self.points([10, 20, 45, 60]), [-0.8, -0.1, 1.0], atol=1e-7)

    def test_border_belongs_to_the_later_cell_and_ties_keep_the_earlier_event(self):
        np.testing.assert_allclose(self.points([25]), [-1.0, -0.5, 1.0], atol=1e-7)
        np.testing.assert_allclose(self.points([40, 60]), [-1.0, -0.2, 1.0], atol=1e-7)

    def test_exact_ties_around_an_inexact_pivot(self):
        # Pivot 120000 / 3 has no exact float64 time: rounding must not choose.
        for offset in range(1, 6000, 371):
            got = self.points([40000 - offset, 40000 + offset], n=4, end=120000)
            self.assertEqual(got[1], np.float32((2 * (40000 - offset) - 120000) / 120000))

    def test_release_normalises_to_zero_one(self):
        # Times become 0, 0.1, 0.6, 1: only the pivots of the second half can move.
        np.testing.assert_allclose(self.points([20, 30, 80, 120], m.RELEASE, n=5), [-1, -.5, 0, .6, 1], atol=1e-7)
        np.testing.assert_allclose(self.points([0, 10, 60, 100], n=5), [-1, -.5, .2, .5, 1], atol=1e-7)

    def test_no_events(self):
        np.testing.assert_allclose(self.points([]), [-1, 0, 1])


class Files(unittest.TestCase):
    def test_round_trip(self):
        model = m.ECIR(width=4).eval()
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "a.safetensors")
            export.write_safetensors(path, export.model_tensors(model), export.model_metadata(model, training="t"))
            again, metadata = export.load_model(path)
            self.assertEqual(metadata["histogram_bins"], "40")
            for (name, a), b in zip(model.state_dict().items(), again.state_dict().values()):
                self.assertTrue(torch.equal(a, b), name)
            with open(path, "r+b") as f:
                f.truncate(os.path.getsize(path) - 4)
            with self.assertRaisesRegex(ValueError, "truncated"):
                export.load_model(path)

    def test_import_of_published_state_dicts(self):
        model = m.ECIR(m.RELEASE, 4, 26)
        script = os.path.join(HERE, "import_release.py")
        with tempfile.TemporaryDirectory() as folder:
            paths = [os.path.join(folder, name) for name in ("g.pth", "r.pth", "out.safetensors")]
            torch.save({"module." + k: v for k, v in model.unet.state_dict().items()}, paths[0])
            torch.save(model.refine.state_dict(), paths[1])
            subprocess.run([sys.executable, script, *paths[:2], "-o", paths[2]], check=True)
            tensors, metadata = export.read_safetensors(paths[2])
            self.assertEqual(metadata["variant"], "release")
            np.testing.assert_array_equal(tensors["unet.pred.weight"], model.unet.pred.weight.detach().numpy())
            self.assertFalse([name for name in tensors if "num_batches" in name])
            swapped = subprocess.run([sys.executable, script, paths[1], paths[0], "-o", paths[2]],
                                     capture_output=True, text=True)
            self.assertNotEqual(swapped.returncode, 0)
            self.assertIn("swapped", swapped.stderr)


class Simulator(unittest.TestCase):
    photos = scenes.Photos([np.random.default_rng(5).random((160, 200)).astype(np.float32)])

    def scene(self, index=0, travel=12, **options):
        return simulate.make_scene(self.photos, 1, index, (48, 64), travel, **options)

    def test_seeded(self):
        a, b, c = self.scene(), self.scene(), self.scene(1)
        for name in ("blurry", "truth", "t", "x", "y", "p", "times"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
        self.assertFalse(np.array_equal(a.blurry, c.blurry))

    def test_travel_is_the_length_of_the_translation(self):
        for index in range(4):
            motion_path = scenes.Motion(np.random.default_rng(index), (180, 240), 30.0)
            self.assertAlmostEqual(np.hypot(*np.diff(motion_path.shift)).sum(), 30.0, 9)

    def test_velocity_carries_the_picture(self):
        world = scenes.World(np.random.default_rng(3), [cv2.GaussianBlur(self.photos[0], (0, 0), 3)], (96, 96), 20.0)
        world.objects = []
        step = 0.02
        field = np.stack([cv2.resize(f, (96, 96)) for f in world.velocity(0.1 + step / 2, 4)])
        y, x = np.indices((96, 96)).astype(np.float32)
        moved = cv2.remap(world.render(0.1 + step), x + step * field[0], y + step * field[1], cv2.INTER_LINEAR)
        inside = np.s_[12:-12, 12:-12]
        still = np.abs(world.render(0.1 + step) - world.render(0.1))[inside].mean()
        self.assertLess(np.abs(moved - world.render(0.1))[inside].mean(), 0.35 * still)

    def test_a_standing_camera_sees_objects_move(self):
        source = scenes.StandingPhotos([np.random.default_rng(0).random((200, 300)).astype(np.float32)])
        scene = simulate.make_scene(source, 5, 0, (48, 64), 12.0)
        self.assertEqual(scene.world.travel(), 0)
        self.assertGreater(scene.world.fastest(), 0)
        moved = (scene.truth[0] != scene.truth[-1]).mean()
        self.assertGreater(moved, 0)
        self.assertLess(moved, 0.9)

    def test_events_follow_the_log_intensity(self):
        sensor = Sensor(positive=0.2, negative=0.2, sigma=0.0, warm=False)
        level = np.exp(np.linspace(-2, -2 + 1.1, 12)) - sensor.log_eps
        t, _, _, p = sensor.events(np.random.default_rng(1), [np.full((1, 1), v, np.float32) for v in level],
                                   np.arange(12) * 100.0)
        np.testing.assert_allclose(t, np.arange(1, 6) * 200, atol=1)
        self.assertTrue((p == 1).all())

    def test_faults_add_and_drop_events(self):
        still = [np.full((40, 40), 0.5, np.float32)] * 2

        def count(**faults):
            return len(Sensor(**faults).events(np.random.default_rng(2), still, (0.0, 120000.0))[0])
        self.assertEqual(count(), 0)
        self.assertAlmostEqual(count(noise_hz=10.0), 1600 * 1.2, delta=150)
        self.assertGreater(count(hot=0.01), 20)
        self.assertAlmostEqual(count(noise_hz=10.0, lost=0.25), 1600 * 0.9, delta=150)
        self.assertLess(count(noise_hz=10.0, late_us=60000), 0.6 * 1600 * 1.2)


class Always:
    """Stands in for a generator: random() gives these values one after the other."""

    def __init__(self, values):
        self.values = iter(values)

    def random(self):
        return next(self.values)


class Packing(unittest.TestCase):
    photos = Simulator.photos

    def test_reversing_time_twice_changes_nothing(self):
        for make, task, chances in ((pack.curve_arrays, task_ecir, [0, 1, 1, 0]),
                                    (pack.fusion_arrays, task_fusion, [0, 1, 1, 1])):
            packed = {name: torch.from_numpy(v) for name, v in make(self.photos, 1, 0, (48, 64)).items()}
            once = task.augment(packed, Always(chances))
            self.assertFalse(torch.equal(once["truth"], packed["truth"]))
            twice = task.augment(once, Always(chances))
            for name in packed:
                self.assertTrue(torch.equal(twice[name], packed[name]), name)

    def test_videos(self):
        texture = cv2.GaussianBlur(np.random.default_rng(6).random((200, 300)).astype(np.float32), (0, 0), 3)
        texture = np.round(255 * (texture - texture.min()) / np.ptp(texture)).astype(np.uint8)
        with tempfile.TemporaryDirectory() as folder:
            os.mkdir(os.path.join(folder, "000"))
            for i in range(17):
                cv2.imwrite(os.path.join(folder, "000", f"{i:08d}.png"), texture[10:190, 2 * i:2 * i + 240])
            source = video.Videos(folder)
            # Two pixels a frame to the left, and half-way between two frames as well.
            world = source.world(np.random.default_rng(1), (180, 240), None)
            self.assertAlmostEqual(world.travel(), 2 * 14.4, delta=1)
            self.assertAlmostEqual(float(np.median(world.velocity(0.2, 4)[0])), -14.4, delta=0.5)
            between = world.render((7.5 / 14.4) * 2 - 1)
            expected = texture[10:190, 15:255] / 255
            self.assertLess(np.abs(between - expected)[20:-20, 20:-20].mean(), 0.01)
            packed = pack.curve_arrays(source, 1, 0, (180, 240))
            self.assertEqual(packed["truth"].shape, (20, 180, 240))
            self.assertGreater(int(packed["histogram"].sum()), 1000)

    def test_shards(self):
        with tempfile.TemporaryDirectory() as cache:
            for first, count in ((0, 2), (2, 1)):
                pack.build_shard(pack.fusion_arrays, self.photos, os.path.join(cache, f"{first:06d}"), 1, first,
                                 count, (32, 48))
            shards = pack.Shards(cache)
            self.assertEqual(len(shards), 3)
            expected = pack.fusion_arrays(self.photos, 1, 2, (32, 48))
            np.testing.assert_array_equal(shards.scene(2)["prior"].numpy(), expected["prior"])
            self.assertRaises(FileNotFoundError, pack.Shards, os.path.join(cache, "none"))


class PriorTest(unittest.TestCase):
    def test_ramps_and_mean(self):
        # One pixel, events at 0 (brighter) and 0.5 (darker), thresholds 0.3 and 0.2.
        p = prior.Prior([0.0, 0.5], [0, 0], [0, 0], [1, 0], (1, 1), (0.3, 0.2))
        levels = [float(p.at(t)) for t in (-1, -0.06, -0.025, 0, 0.44, 0.475, 0.5, 1)]
        np.testing.assert_allclose(levels, [0, 0, 0.15, 0.3, 0.3, 0.2, 0.1, 0.1], atol=1e-9)
        mean = (0.975 + 0.5 * np.exp(0.3) + 0.525 * np.exp(0.1)) / 2
        self.assertAlmostEqual(float(p.log_mean()), np.log(mean), 12)
        surface = p.surfaces(0.25)[:, 0, 0]
        expected = [np.exp(-0.25 / d) for d in prior.SURFACES] + [-np.exp(-0.25 / d) for d in prior.SURFACES]
        np.testing.assert_allclose(surface, expected, rtol=1e-6)

    def test_no_events(self):
        none = np.zeros(0, int)
        p = prior.Prior(none, none, none, none, (2, 3), (0.2, 0.2))
        np.testing.assert_allclose(p.frames(np.full((2, 3), 0.3), [-1, 0.2]), 0.3, rtol=1e-6)
        self.assertEqual(np.abs(p.surfaces(0.0)).max(), 0)
        self.assertEqual(p.counts(motion.ANCHORS).sum(), 0)


class FusionTest(unittest.TestCase):
    def test_motion_of_a_moving_pattern(self):
        y, x = np.indices((72, 90))
        v = np.array([6.0, -3.0])
        frames = np.stack([0.5 + 0.2 * np.sin((x - v[0] * t) / 4) + 0.2 * np.cos((y - v[1] * t) / 5)
                           for t in motion.TIMES])
        inside = np.s_[:, :, 2:-2, 2:-2]
        first = motion.first_estimate(frames)
        refined = motion.estimate(frames)
        np.testing.assert_allclose(first[inside].mean((0, 2, 3)), v * 2 / motion.GAPS, rtol=0.1)
        np.testing.assert_allclose(refined[inside].mean((0, 2, 3)), v * 2 / motion.GAPS, rtol=0.04)

    def test_trajectories_of_an_even_motion(self):
        speed = torch.tensor([5.0, -2.0])
        moved = (speed * 2 / fusion.GAPS).view(1, 1, 2, 1, 1).expand(3, fusion.GAPS, 2, 5, 6)
        times = torch.tensor([-1.0, 0.3, 1.0])
        path = fusion.trajectories(moved, times, 40, 48)
        start = fusion.pixel_grid(40, 48, fusion.STRIDE, "cpu")
        for i, t in enumerate(times):
            for j, s in enumerate(torch.linspace(-1, 1, fusion.ANCHORS)):
                expected = start + (s - t) * speed.view(2, 1, 1)
                self.assertTrue(torch.allclose(path[i, j], expected, atol=1e-4))

    def test_transposed_convolution_equals_torch(self):
        up, x = fusion._Up(6, 4), torch.rand(2, 6, 5, 7)
        for size in ((9, 13), (10, 14), (9, 14)):
            skip = torch.randn(2, 4, *size)
            self.assertTrue(torch.allclose(up(x, skip), F.relu(up.conv(x, output_size=size) + skip), atol=1e-5))

    def test_similarity_is_that_of_the_benchmark(self):
        truth = np.random.default_rng(5).uniform(0, 1, (2, 33, 40)).round(2)
        frames = (truth * 0.9 + np.random.default_rng(6).normal(0, 0.1, truth.shape)).clip(0, 1)
        expected = np.mean([structural_similarity(a, b, data_range=1) for a, b in zip(frames, truth)])
        found = task_fusion.similarity(torch.from_numpy(frames)[None], torch.from_numpy(truth)[None])
        self.assertAlmostEqual(float(found), expected, places=9)

    def test_starts_from_the_prior_and_takes_any_size(self):
        model = task_fusion.build({"trunk": (8, 8, 8, 8), "head": (8, 8, 8)}).eval()
        with torch.no_grad():
            model.head.out.weight.zero_()
            model.head.out.bias.zero_()
            for height, width in ((16, 16), (33, 47)):
                prior_frames = torch.rand(1, 2, height, width)
                cells = (-(-height // 8), -(-width // 8))
                exposure = (torch.rand(1, 9, height, width), torch.rand(1, 1, height, width),
                            torch.zeros(1, 8, height, width), torch.zeros(1, 8, 2, *cells))
                frames = model(exposure, prior_frames, torch.zeros(1, 2, 4, height, width),
                                  torch.tensor([[-1.0, 0.123]]))
                self.assertTrue(torch.equal(frames, prior_frames))


if __name__ == "__main__":
    unittest.main()
