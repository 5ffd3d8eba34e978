"""What all peers are given: random weights of the published size, one exposure, the frames that must come out.

A case is a folder, made once for its settings and this source code: weights.safetensors, blurry.png and events.txt
for ecir; the network's inputs, and the frames in float64, as raw float32 arrays whose shapes stand in case.json;
FORM-whole.onnx, and FORM-STAGE.onnx of each stage.
"""
import glob
import hashlib
import json
import os
import shutil
import warnings

import cv2
import numpy as np
import torch

import networks     # first: it makes the modules of tools/train importable
import events
import make_fixtures
import model
from events import network_inputs
from export import load_model, model_metadata, model_tensors, write_safetensors
from make_fixtures import EXPOSURE_US, scaled_network, synthetic_blurry, synthetic_events

KEYPOINTS, BINS, EVENTS = 10, 40, 100_000
INPUTS = ("blurry", "histogram", "keypoints", "between")
OPSET = 13


def made_case(work, *settings):
    """Folder in `work` of the case of these arguments of write_case(), made when it is not there; one is kept."""
    digest = hashlib.sha256(repr((settings, torch.__version__)).encode())
    for name in (__file__, networks.__file__, model.__file__, events.__file__, make_fixtures.__file__):
        with open(name, "rb") as file:
            digest.update(file.read())
    folder = os.path.join(work, "case-" + digest.hexdigest()[:12])
    if not os.path.exists(os.path.join(folder, "case.json")):
        for old in glob.glob(os.path.join(work, "case-*")):
            shutil.rmtree(old)
        write_case(folder, *settings)
    return folder


def write_case(folder, size, frames, iterations, variant, width=64, seed=1, count=EVENTS):
    """Makes the case in `folder`; size is (H, W), frames even ones over the exposure. Deterministic."""
    os.makedirs(folder, exist_ok=True)
    rng = np.random.default_rng(seed)
    blurry = synthetic_blurry(rng, *size).astype(np.float32)
    t, x, y, p = synthetic_events(rng, *size, count)
    times = np.linspace(-1, 1, frames) if frames > 1 else np.zeros(1)
    bins = BINS if variant == "paper" else 26
    counts, points, between = network_inputs(t, x, y, p, 0, EXPOSURE_US, size, variant, bins, KEYPOINTS, times)
    arrays = dict(zip(INPUTS, (blurry[None], counts, points, between)))
    exact = [torch.from_numpy(np.asarray(a, np.float64))[None]
             for a in (blurry[None], counts, points, times, between)]
    network = scaled_network(rng, variant, bins, exact, width, iterations)
    with torch.no_grad():
        arrays["frames"] = network(exact[0], exact[1], exact[2], times, exact[4])[1][0].numpy()

    write_safetensors(os.path.join(folder, "weights.safetensors"), model_tensors(network),
                      model_metadata(network, training="none: random weights"))
    cv2.imwrite(os.path.join(folder, "blurry.png"), np.round(blurry * 255).astype(np.uint8))
    with open(os.path.join(folder, "events.txt"), "w", encoding="ascii") as file:
        file.write(f"{size[1]} {size[0]}\n")
        file.writelines(f"{us // 1_000_000}.{us % 1_000_000:06d} {i} {j} {sign}\n"
                        for us, i, j, sign in zip(t.tolist(), x.tolist(), y.tolist(), p.tolist()))
    for name, array in arrays.items():
        np.ascontiguousarray(array, "<f4").tofile(os.path.join(folder, name + ".f32"))
    parameters = sum(value.numel() for value in network.parameters())
    case = {"size": list(size), "times": times.tolist(), "exposure": [0, EXPOSURE_US], "iterations": iterations,
            "variant": variant, "parameters": parameters, "events": len(t),
            "shapes": {name: [1, *array.shape] for name, array in arrays.items()}}
    with open(os.path.join(folder, "case.json"), "w", encoding="utf-8") as file:
        json.dump(case, file)


def read_case(folder):
    with open(os.path.join(folder, "case.json"), encoding="utf-8") as file:
        return json.load(file)


def read_array(folder, case, name):
    """float32, with the batch's 1 in front."""
    return np.fromfile(os.path.join(folder, name + ".f32"), "<f4").reshape(case["shapes"][name])


def load(folder, form, device="cpu"):
    """The network of a case in one of the forms of networks.py, by its name, and its inputs."""
    case = read_case(folder)
    network, _ = load_model(os.path.join(folder, "weights.safetensors"))
    inputs = [torch.from_numpy(read_array(folder, case, name)).to(device) for name in INPUTS]
    return getattr(networks, form)(network, case["times"]).to(device), inputs


def export_onnx(folder, form):
    """Writes FORM-STAGE.onnx of each stage and FORM-whole.onnx, for the case's shapes, where they are not there."""
    if os.path.exists(os.path.join(folder, f"{form}-whole.onnx")):
        return
    path, inputs = load(folder, form)
    names = {"unet": (INPUTS[:3], "derivative"), "curve": (("blurry", "derivative", "keypoints"), "initial"),
             "refine": (("initial", "between"), "frames")}
    with torch.no_grad():
        arguments = networks.stage_inputs(path, inputs)
        graphs = [(stage, getattr(path, stage), arguments[stage], *names[stage]) for stage in networks.STAGES]
        graphs.append(("whole", path, tuple(inputs), INPUTS, "frames"))
        for name, module, given, inside, output in graphs:
            with warnings.catch_warnings():     # that sizes become constants: they are, here
                warnings.simplefilter("ignore")
                partial = os.path.join(folder, f"{form}-{name}.partial")
                torch.onnx.export(module, given, partial, opset_version=OPSET, input_names=list(inside),
                                  output_names=[output])
            os.replace(partial, os.path.join(folder, f"{form}-{name}.onnx"))
