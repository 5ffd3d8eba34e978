#!/usr/bin/env python3
"""safetensors, written and read by hand, and the export of a trained checkpoint.

The format: the header's length as a little-endian uint64, a JSON header (name -> dtype, shape,
data_offsets, plus the strings of __metadata__), the tensors' bytes.
"""
import argparse
import json
import os
import struct
import sys

import numpy as np

DTYPES = {"F32": np.dtype("<f4"), "F16": np.dtype("<f2")}


def write_safetensors(path, tensors, metadata):
    """Writes name -> float32/float16 array and str -> str metadata; the file appears when complete."""
    names = {dtype: name for name, dtype in DTYPES.items()}
    header, offset, blocks = {"__metadata__": {k: str(v) for k, v in metadata.items()}}, 0, []
    for name, array in tensors.items():
        array = np.asarray(array)
        if array.dtype not in names:
            raise ValueError(f"{path}: tensor '{name}' is {array.dtype}: use float32 or float16")
        block = np.ascontiguousarray(array).tobytes()
        header[name] = {"dtype": names[array.dtype], "shape": list(array.shape),
                        "data_offsets": [offset, offset + len(block)]}
        blocks.append(block)
        offset += len(block)
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    temporary = path + ".partial"
    with open(temporary, "wb") as f:
        f.write(struct.pack("<Q", len(text)) + text)
        for block in blocks:
            f.write(block)
    os.replace(temporary, path)


def read_safetensors(path):
    """Returns (name -> array, metadata); raises ValueError naming the file and what is wrong."""
    with open(path, "rb") as f:
        data = f.read()
    length = struct.unpack("<Q", data[:8])[0] if len(data) >= 8 else len(data)
    if 8 + length > len(data):
        raise ValueError(f"{path}: not a safetensors file, or truncated in its header")
    try:
        header = json.loads(data[8:8 + length])
    except ValueError:
        raise ValueError(f"{path}: the header is not JSON") from None
    tensors, metadata = {}, header.pop("__metadata__", {})
    for name, entry in header.items():
        begin, end = entry["data_offsets"]
        dtype, shape = DTYPES.get(entry["dtype"]), entry["shape"]
        if dtype is None:
            raise ValueError(f"{path}: tensor '{name}' is {entry['dtype']}: only F32 and F16 are read")
        block = data[8 + length + begin:8 + length + end]
        if len(block) != dtype.itemsize * int(np.prod(shape)):
            raise ValueError(f"{path}: tensor '{name}' is truncated or its shape does not fit its offsets")
        tensors[name] = np.frombuffer(block, dtype).reshape(shape)
    return tensors, metadata


def model_metadata(model, **more):
    """The contract's metadata of an ECIR module."""
    return {"model": "ecir", "variant": model.variant, "keypoints": model.n,
            "histogram_bins": model.bins, "iterations": model.refine.iterations, **more}


def model_tensors(model, dtype=np.float32):
    """Weights under their contract names; batch counters are left out, nothing else."""
    return {name: value.detach().cpu().numpy().astype(dtype)
            for name, value in model.state_dict().items() if not name.endswith("num_batches_tracked")}


def load_model(path):
    """ECIR module in evaluation mode from a safetensors file; returns (model, metadata)."""
    import torch
    from model import ECIR
    tensors, metadata = read_safetensors(path)
    if metadata.get("model") != "ecir":
        raise ValueError(f"{path}: metadata says model '{metadata.get('model')}', not 'ecir'")
    try:
        width = tensors["unet.en_conv1.0.weight"].shape[0]
        model = ECIR(metadata["variant"], width, int(metadata["histogram_bins"]),
                     int(metadata["keypoints"]), int(metadata["iterations"]))
    except KeyError as missing:
        raise ValueError(f"{path}: lacks {missing}") from None
    state = {name: torch.from_numpy(value.astype(np.float32)) for name, value in tensors.items()
             if name.startswith(("unet.", "refine."))}
    expected = {name: value.shape for name, value in model.state_dict().items()
                if not name.endswith("num_batches_tracked")}
    for name, shape in expected.items():
        if name not in state:
            raise ValueError(f"{path}: lacks tensor '{name}'")
        if state[name].shape != shape:
            raise ValueError(f"{path}: tensor '{name}' is {list(state[name].shape)}, expected {list(shape)}")
    model.load_state_dict(state, strict=False)
    return model.eval(), metadata


def main():
    import torch
    from train import TASKS
    parser = argparse.ArgumentParser(description="Export a training checkpoint as safetensors.")
    parser.add_argument("checkpoint", help="checkpoint.pt written by train.py")
    parser.add_argument("-o", "--output", required=True, help="safetensors file to write")
    parser.add_argument("--float32", action="store_true", help="keep float32 (default: float16)")
    args = parser.parse_args()
    try:
        state = torch.load(args.checkpoint, map_location="cpu")
        task = TASKS[state["network"]]
        model = task.build(state["config"])
        model.load_state_dict(state["average"])
        write_safetensors(args.output, *task.export(model, np.float32 if args.float32 else np.float16,
                                                    state["summary"]))
    except (OSError, ValueError, KeyError) as error:
        sys.exit(f"export: {args.checkpoint}: {error}")


if __name__ == "__main__":
    main()
