"""The peers as processes of which one works at a time: each is told to take its turn and answers with its times."""
import contextlib
import json
import os
import shutil
import subprocess
import sys
import tempfile

import numpy as np

import case
from paths import HERE


class PeerError(Exception):
    """Why a peer cannot take part; the message says what to do about it."""


class Worker:
    """A process that stays between turns, so that it is warm: torch_worker.py or onnx_worker.js."""

    def __init__(self, command, frames, environment=None):
        """frames: the file that it writes its frames to before it answers for the first time."""
        self.errors = tempfile.TemporaryFile("w+")
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self.errors,
                                        text=True, env=environment)
        self.frames_file = frames
        self.versions = self.answer()["versions"]

    def answer(self):
        line = self.process.stdout.readline()
        if not line:
            self.process.wait()
            self.errors.seek(0)
            said = self.errors.read().strip() or "it said nothing"
            self.close()
            raise PeerError(f"its process ended with {self.process.returncode}: {said}")
        return json.loads(line)

    def turn(self):
        """{"ms", "stages"} of a frame."""
        with contextlib.suppress(BrokenPipeError):  # answer() says why
            self.process.stdin.write("\n")
            self.process.stdin.flush()
        return self.answer()

    def frames(self):
        """float32, flat."""
        return np.fromfile(self.frames_file, "<f4")

    def close(self):
        with contextlib.suppress(BrokenPipeError):
            self.process.stdin.close()
        self.process.wait()
        self.process.stdout.close()
        self.errors.close()


class Ecir:
    """The program, a process a turn: `ecir bench` warms up and times by itself."""

    def __init__(self, program, model, options, folder, random_weights):
        """options: of both ecir bench and ecir deblur; random_weights: the model is the case's own."""
        if not os.access(program, os.X_OK):
            raise PeerError(f"no program '{program}'; build it (tools/demo), or name it with --ecir")
        self.program, self.model, self.options, self.folder = os.path.abspath(program), model, options, folder
        self.case, self.checked, self.versions = case.read_case(folder), random_weights, None
        self.refine = ["--refine", str(self.case["iterations"])] if random_weights else []

    def run(self, *arguments):
        command = [self.program, *arguments]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            said = done.stderr.strip() or done.stdout.strip()
            raise PeerError(f"exit {done.returncode} of {' '.join(command)}: {said}")
        return done.stdout

    def turn(self):
        height, width = self.case["size"]
        text = self.run("bench", "--model", self.model, "--size", f"{width}x{height}", "--frames",
                        str(len(self.case["times"])), *self.refine, *self.options, "--json")
        try:
            result = json.loads(text)
            model, = result["models"]
            self.versions = f"ecir, {result['device']}, {result['driver']}"
            return {"ms": float(model["ms"]), "stages": {}}
        except (ValueError, KeyError, TypeError) as error:
            raise PeerError(f"ecir bench: not the JSON that was expected ({error!r}): {text[:200]}") from None

    def frames(self):
        """float32, flat; None for a model whose weights no other peer has."""
        if not self.checked:
            return None
        with tempfile.TemporaryDirectory() as folder:
            output = os.path.join(folder, "frames.npy")
            start, end = self.case["exposure"]
            self.run("deblur", "-i", os.path.join(self.folder, "blurry.png"), "-e",
                     os.path.join(self.folder, "events.txt"), "--exposure", str(start), str(end), "-o", output,
                     "-m", self.model, "--frames", str(len(self.case["times"])), *self.refine, *self.options)
            return np.load(output).ravel()

    def close(self):
        pass


def torch_worker(folder, form, threads, device, seconds):
    environment = dict(os.environ)
    if form == "best":  # large buffers stay mapped: 3 % faster
        environment.update(MALLOC_MMAP_THRESHOLD_="4000000000", MALLOC_TRIM_THRESHOLD_="8000000000")
    return Worker([sys.executable, "-B", os.path.join(HERE, "torch_worker.py"), folder, form, str(threads), device,
                   str(seconds)], os.path.join(folder, f"torch-{form}.f32"), environment)


def onnx_worker(folder, form, modules, threads, seconds):
    case.export_onnx(folder, form)
    return Worker(["node", os.path.join(HERE, "onnx_worker.js"), folder, form, modules, str(threads), str(seconds)],
                  os.path.join(folder, f"onnxruntime-{form}.f32"))


def installed_onnxruntime(work, install=True):
    """The node_modules folder with the pinned onnxruntime-node, fetched from npm into `work` on first use."""
    folder = os.path.join(work, "node")
    modules = os.path.join(folder, "node_modules")
    with open(os.path.join(HERE, "package.json"), encoding="utf-8") as file:
        wanted = json.load(file)["dependencies"]["onnxruntime-node"]
    try:
        with open(os.path.join(modules, "onnxruntime-node", "package.json"), encoding="utf-8") as file:
            if json.load(file)["version"] == wanted:
                return modules
    except OSError:
        pass
    if not install:
        raise PeerError(f"onnxruntime-node {wanted} is not in {modules}")
    for program in ("node", "npm"):
        if not shutil.which(program):
            raise PeerError(f"it needs {program}, which is not installed (Debian: apt-get install nodejs npm)")
    os.makedirs(folder, exist_ok=True)
    shutil.copy(os.path.join(HERE, "package.json"), folder)
    print(f"bench_peers: installing onnxruntime-node {wanted} (300 MB) into {folder}", file=sys.stderr)
    # Without scripts: the CPU's library comes with the package, its script would fetch the one for CUDA.
    done = subprocess.run(["npm", "install", "--ignore-scripts", "--no-audit", "--no-fund"], cwd=folder,
                          capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise PeerError(f"npm could not install onnxruntime-node {wanted} into {folder} (is the registry reachable?): "
                        f"{done.stderr.strip()}")
    return modules
