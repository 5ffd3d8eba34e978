"""Unit tests: python3 -m unittest test_bench_peers (from tools/peers). Nothing is downloaded: ONNX Runtime takes part
where bench_peers has installed it before. ECIR_TOOL=PROGRAM adds the program's frames."""
import io
import json
import os
import shutil
import stat
import subprocess
import sys
import tempfile
import unittest
from contextlib import redirect_stderr
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from unittest import mock

import numpy as np
import torch

import case
import networks
import report
import workers
from model import PAPER, RELEASE, chebyshev_nodes, derivative_at_nodes, frame_matrix, pivots, render
from paths import ROOT

SIZE, FRAMES, ITERATIONS, WIDTH = (45, 61), 4, 2, 4
TOLERANCE = 1e-3    # monomials in float32 lose digits where keypoints come close
SMALL = ("--size", "32x24", "--width", "4", "--frames", "3", "--refine", "1", "--threads", "1")
BENCH = os.path.join(ROOT, "tools", "bench_peers")
TOOL = os.environ.get("ECIR_TOOL", os.path.join(ROOT, "build/dev/ecir"))


class Cases(unittest.TestCase):
    """One small case, made once."""

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp()
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        torch.set_num_threads(1)
        case.write_case(cls.folder, SIZE, FRAMES, ITERATIONS, PAPER, WIDTH, count=4000)
        cls.case = case.read_case(cls.folder)
        cls.exact = case.read_array(cls.folder, cls.case, "frames")

    def assert_close(self, frames):
        self.assertLess(np.abs(np.ravel(frames) - self.exact.ravel()).max(), TOLERANCE)

    def test_all_forms_give_the_frames_of_float64(self):
        self.assertGreater(self.exact.std(), 0.05)
        for form in ("published", "plain", "best"):
            with self.subTest(form), torch.no_grad():
                path, inputs = case.load(self.folder, form)
                self.assert_close(path(*inputs).numpy())

    def test_torch_worker_times_its_stages(self):
        for form in ("published", "best"):
            peer = workers.torch_worker(self.folder, form, 1, "cpu", 0.01)
            self.addCleanup(peer.close)
            self.assert_close(peer.frames())
            turn = peer.turn()
            self.assertEqual(set(turn["stages"]), set(networks.STAGES))
            self.assertGreater(min(turn["stages"].values()), 0)
            self.assertLess(sum(turn["stages"].values()), 3 * turn["ms"])
            self.assertIn(torch.__version__, peer.versions)

    def test_a_worker_that_fails_says_why(self):
        with self.assertRaisesRegex(workers.PeerError, "nosuchform"):
            workers.torch_worker(self.folder, "nosuchform", 1, "cpu", 0.01)

    def test_export(self):
        for form in ("plain", "best"):
            case.export_onnx(self.folder, form)
            for name in ("whole", *networks.STAGES):
                self.assertGreater(os.path.getsize(os.path.join(self.folder, f"{form}-{name}.onnx")), 1000)
        self.assertEqual([name for name in os.listdir(self.folder) if name.endswith(".partial")], [])

    def test_onnxruntime_gives_the_same_frames(self):
        try:
            modules = workers.installed_onnxruntime(os.path.join(ROOT, "build/peers"), install=False)
        except workers.PeerError as error:
            self.skipTest(str(error))
        for form in ("plain", "best"):
            peer = workers.onnx_worker(self.folder, form, modules, 1, 0.01)
            self.addCleanup(peer.close)
            self.assert_close(peer.frames())
            self.assertEqual(set(peer.turn()["stages"]), set(networks.STAGES))

    @unittest.skipUnless(os.access(TOOL, os.X_OK), "no ecir program")
    def test_ecir_gives_the_same_frames(self):
        weights = os.path.join(self.folder, "weights.safetensors")
        self.assert_close(workers.Ecir(TOOL, weights, [], self.folder, True).frames())

    def test_ecir_bench_is_asked_for_the_case(self):
        """A program in ecir's place: what is asked of it, and what is made of its answers."""
        program, asked = os.path.join(self.folder, "program"), os.path.join(self.folder, "asked")
        answer = {"device": "D", "driver": "V", "models": [{"name": "n", "ms": 12.5}]}

        def says(text):
            with open(program, "w", encoding="utf-8") as file:
                file.write(f"#!/bin/sh\necho \"$@\" >'{asked}'\n{text}\n")
            os.chmod(program, stat.S_IRWXU)
        says(f"echo '{json.dumps(answer)}'")
        peer = workers.Ecir(program, "model", ["-g", "1"], self.folder, True)
        self.assertEqual(peer.turn(), {"ms": 12.5, "stages": {}})
        self.assertIn("D, V", peer.versions)
        with open(asked, encoding="utf-8") as file:
            self.assertEqual(file.read().split(), "bench --model model --size 61x45 --frames 4 --refine 2 -g 1 "
                             "--json".split())
        says("echo '{}'")
        self.assertRaisesRegex(workers.PeerError, "not the JSON", peer.turn)
        says("echo why >&2; exit 4")
        self.assertRaisesRegex(workers.PeerError, "exit 4 .*why", peer.turn)


class Curves(unittest.TestCase):
    def test_both_curves_are_that_of_model_py(self):
        generator = torch.Generator().manual_seed(1)
        derivative = torch.randn((1, 10, 6, 7), generator=generator)
        blurry = torch.rand((1, 1, 6, 7), generator=generator)
        jitter = 0.09 * (2 * torch.rand((1, 10, 6, 7), generator=generator) - 1)
        points = (torch.from_numpy(pivots(10)).float().view(1, 10, 1, 1) + jitter).clamp(-1, 1)
        times = np.linspace(-1, 1, 5)
        for variant in (PAPER, RELEASE):
            exact = render(blurry.double(), derivative_at_nodes(derivative.double(), points.double(), variant,
                                                                chebyshev_nodes(10)), frame_matrix(times, 10))
            for curve in (networks.PublishedCurve(times, variant), networks.QuickCurve(times, variant, 10)):
                error = (curve(blurry, derivative, points) - exact).abs().max()
                self.assertLess(error, 1e-3 * exact.abs().max())


class Reports(unittest.TestCase):
    def test_ratios_are_of_the_same_round(self):
        rows = {"a": {"rounds": [1.0, 20.0, 3.0]}, "b": {"rounds": [2.0, 10.0, 3.0]}}
        self.assertEqual(report.ratios(rows, ["b", "c"]),
                         {"a": {"b": {"median": 1.0, "low": 0.5, "high": 2.0}}, "b": {}})

    def test_table_is_aligned(self):
        self.assertEqual(report.table(["a", "long"], [["word", "1"]]), "a     long\nword     1")


class Installation(unittest.TestCase):
    def test_without_npm_the_message_says_what_to_install(self):
        with tempfile.TemporaryDirectory() as work, mock.patch("shutil.which", return_value=None):
            with self.assertRaisesRegex(workers.PeerError, "node, which is not installed.*apt-get"):
                workers.installed_onnxruntime(work)


class Program(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        loader = SourceFileLoader("bench_peers", BENCH)
        cls.bench_peers = module_from_spec(spec_from_loader("bench_peers", loader))
        loader.exec_module(cls.bench_peers)

    def run_bench(self, *arguments):
        return subprocess.run([sys.executable, "-B", BENCH, *arguments], capture_output=True, text=True, check=False)

    def test_a_small_run(self):
        with tempfile.TemporaryDirectory() as work:
            done = self.run_bench(*SMALL, "--rounds", "2", "--turn", "0.01", "--peers", "torch-published", "torch-best",
                                  "onnxruntime", "fusion", "--no-install", "--work", work, "--ecir", "/no/such/program",
                                  "--json")
        self.assertEqual(done.returncode, 0, done.stderr)
        result = json.loads(done.stdout)
        self.assertEqual(list(result["peers"]), ["torch-published", "torch-best"])
        self.assertEqual(set(result["left_out"]), {"onnxruntime", "fusion"})
        self.assertLess(result["peers"]["torch-best"]["error"], TOLERANCE)
        ratio = result["ratios"]["torch-best"]["torch-published"]
        self.assertGreater(ratio["low"], 0)
        self.assertLess(ratio["median"], 1)     # 5120 products of planes less
        self.assertIn("torch-best", report.text(result))
        self.assertLessEqual(result["peers"]["torch-best"]["others"], 1)

    def test_wrong_frames_are_not_timed(self):
        with tempfile.TemporaryDirectory() as work:
            done = self.run_bench(*SMALL, "--tolerance", "1e-12", "--peers", "torch-best", "--work", work)
        self.assertEqual(done.returncode, 1)
        self.assertIn("torch-best: its frames differ", done.stderr)

    def test_wrong_usage(self):
        for arguments in (["--size", "8x8"], ["--variant", "release", "--frames", "5"], ["--rounds", "0"]):
            with self.subTest(arguments), redirect_stderr(io.StringIO()):
                with self.assertRaises(SystemExit) as stopped:
                    self.bench_peers.parse(arguments)
                self.assertEqual(stopped.exception.code, 2)


if __name__ == "__main__":
    unittest.main()
