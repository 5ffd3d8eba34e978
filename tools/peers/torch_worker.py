"""A peer in PyTorch: a process that times the network whenever it is told to. Started by bench_peers.

usage: torch_worker.py CASE FORM THREADS DEVICE SECONDS    (FORM: published or best)

Writes CASE/torch-FORM.f32 (the frames), then one JSON line {"versions"}; for each line read, one JSON line
{"ms", "stages"} of a turn: a pass that is not counted, then passes for SECONDS, medians. A pass begins with the
inputs and ends with the frames in host memory.
"""
import json
import statistics
import sys
import time

import numpy as np
import torch

import case
import networks


class Peer:
    def __init__(self, folder, form, threads, device):
        torch.set_num_threads(threads)
        self.device = torch.device(device)
        path, self.inputs = case.load(folder, form, self.device)
        self.host = [value.cpu() for value in self.inputs]
        if self.device.type == "cuda":
            torch.backends.cuda.matmul.allow_tf32 = torch.backends.cudnn.allow_tf32 = False
            torch.backends.cudnn.benchmark = form == "best"
        self.path = networks.optimised(path, self.inputs) if form == "best" else path

    def now(self):
        if self.device.type == "cuda":
            torch.cuda.synchronize()
        return time.perf_counter()

    def one_pass(self):
        """The frames, and ms from point to point: upload, U-Net, curve, refinement and download."""
        at = [self.now()]
        blurry, histogram, keypoints, between = (value.to(self.device) for value in self.host)
        at.append(self.now())
        derivative = self.path.unet(blurry, histogram, keypoints)
        at.append(self.now())
        initial = self.path.curve(blurry, derivative, keypoints)
        at.append(self.now())
        frames = self.path.refine(initial, between)
        at.append(self.now())
        frames = frames.cpu().numpy()
        at.append(self.now())
        return frames, 1000 * np.diff(at)

    def turn(self, seconds):
        self.one_pass()
        passes, start = [], time.perf_counter()
        while not passes or time.perf_counter() - start < seconds:
            passes.append(self.one_pass()[1])
        return {"ms": statistics.median(each.sum() for each in passes),
                "stages": dict(zip(networks.STAGES, np.median(passes, 0)[1:4].tolist()))}

    def versions(self):
        where = torch.cuda.get_device_name() if self.device.type == "cuda" else "CPU, oneDNN"
        return f"PyTorch {torch.__version__}, {where}"


def main():
    folder, form, threads, device, seconds = sys.argv[1:]
    with torch.no_grad():
        peer = Peer(folder, form, int(threads), device)
        peer.one_pass()[0].astype("<f4").tofile(f"{folder}/torch-{form}.f32")
        print(json.dumps({"versions": peer.versions()}), flush=True)
        for _ in sys.stdin:
            print(json.dumps(peer.turn(float(seconds))), flush=True)


if __name__ == "__main__":
    main()
