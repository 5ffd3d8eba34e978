"""What is compared: ways to turn a blurry frame and its events into sharp frames, run by `ecir deblur`."""
import glob
import json
import os
import struct
import subprocess
import tempfile
from dataclasses import dataclass

import numpy as np

from cache import file_hash

FRAMES = 14                 # evenly over the exposure
FEW_FRAMES = (0, 6, 13)     # of them, for a method too slow for all: start, middle, end
REFERENCE = "edi-best"      # margins are over this method


class BenchmarkError(Exception):
    """Something that the user can mend; the message says what."""


@dataclass(frozen=True)
class Method:
    name: str
    label: str
    architecture: str       # blurry, edi, or the model of a weights file's metadata
    model: str = ""         # of ecir deblur -m
    options: tuple = ()
    slow: bool = False      # FEW_FRAMES of a few scenes only

    @property
    def takes_threshold(self):
        return self.architecture in ("edi", "fusion")

    @property
    def frames(self):
        return FEW_FRAMES if self.slow else tuple(range(FRAMES))

    def identity(self, ecir):
        """What the results depend on. Those of eSL-Net outlive the program: its weights are published
        and fixed, and the results dear."""
        if self.architecture == "blurry":
            return {"model": self.name}
        model = file_hash(self.model) if os.path.exists(self.model) else self.model
        return {"model": model, "options": self.options, "search": self.name == REFERENCE,
                "ecir": None if self.architecture == "esl_net" else ecir.hash}


class Ecir:
    """The program."""

    def __init__(self, path, device=None):
        self.path = os.path.abspath(path)
        self.device = ["-g", device] if device else []
        if not os.access(self.path, os.X_OK):
            raise BenchmarkError(f"no program '{path}'; build it (tools/demo), or name it with --ecir")
        self.hash = file_hash(self.path)

    def deblur(self, recording, method, *options):
        """Frames float32 [frames, H, W], unclipped, of a recording's exposures one after the other."""
        with tempfile.TemporaryDirectory() as folder:
            output = os.path.join(folder, "frames.npy")
            command = [self.path, "deblur", "-i", recording, "-o", output, "-m", method.model, *self.device,
                       *method.options, *map(str, options)]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode != 0:
                raise BenchmarkError(f"exit {done.returncode} of {' '.join(command)}\n{done.stderr.strip()}")
            frames = np.load(output)
        if frames.ndim == 4:
            raise BenchmarkError(f"{recording}: colour frames; give it grey ones")
        return frames


def read_header(path):
    """Metadata and {tensor: shape} of a safetensors file."""
    try:
        with open(path, "rb") as file:
            size, = struct.unpack("<Q", file.read(8))
            header = json.loads(file.read(size))
    except (OSError, struct.error, ValueError, MemoryError, OverflowError) as error:
        raise BenchmarkError(f"'{path}' is not a readable .safetensors file: {error}") from error
    return header.pop("__metadata__", {}), {name: entry["shape"] for name, entry in header.items()}


def shipped_models(folder):
    return sorted(os.path.splitext(os.path.basename(path))[0]
                  for path in glob.glob(os.path.join(folder, "*.safetensors")))


def network_methods(models, folder, esl_net):
    """Methods of the networks, and notes on models that are not there. models: names or paths."""
    found, notes = [], []
    for model in models:
        path = model if model.endswith(".safetensors") else os.path.join(folder, model + ".safetensors")
        if not os.path.exists(path):
            notes.append(f"{model}: left out, there is no {path}")
            continue
        found.append((os.path.splitext(os.path.basename(path))[0], os.path.abspath(path),
                      read_header(path)[0].get("model", "?")))
    single = sum(kind == "ecir" for *_, kind in found) == 1
    methods = []
    if esl_net:
        if read_header(esl_net)[0].get("model") != "esl_net":
            raise BenchmarkError(f"--esl-net {esl_net}: not a file of tools/train/import_esl_net.py")
        methods.append(Method("esl-net", "eSL-Net", "esl_net", os.path.abspath(esl_net), slow=True))
    for name, path, kind in sorted(found, key=lambda entry: entry[2] != "ecir"):
        if kind == "ecir":
            label = "E-CIR" if single else f"E-CIR ({name})"
            methods += [Method(name + ":initial", label + " initialisation", kind, path, ("--refine", "0")),
                        Method(name, label + " refined", kind, path)]
        elif kind == "esl_net":
            raise BenchmarkError(f"{path}: eSL-Net is given with --esl-net")
        else:
            methods.append(Method(name, name, kind, path))
    return methods, notes


def runnable(ecir, methods, recording):
    """The methods that the program has, and a note on each that it has not."""
    kept, notes = [], []
    for method in methods:
        try:
            if method.model:
                ecir.deblur(recording, method, "--times", 0)
            kept.append(method)
        except BenchmarkError as error:
            notes.append(f"{method.label}: left out, the program refuses it: {str(error).splitlines()[-1]}")
    return kept, notes


def all_methods(models, folder, esl_net):
    networks, notes = network_methods(models, folder, esl_net)
    return [Method("blurry", "blurry frame", "blurry"),
            Method("edi", "EDI, estimated thresholds", "edi", "edi"),
            Method(REFERENCE, "EDI, best single threshold", "edi", "edi"), *networks], notes
