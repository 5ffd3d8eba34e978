#!/usr/bin/env python3
"""Published eSL-Net weights (without super-resolution) as a safetensors file for ecir deblur -m."""
import argparse
import sys
from collections.abc import Mapping

import numpy as np

from esl_net import EslNet, export_esl_net


def fail(path, what):
    sys.exit(f"import_esl_net: {path}: {what}")


def read_arrays(path):
    """Name -> array of an .npz file or of a PyTorch state dict, told by content."""
    try:
        with open(path, "rb") as f:
            f.read(1)
    except OSError as error:
        fail(path, f"cannot be read: {error.strerror}")
    try:
        archive = np.load(path, allow_pickle=False)
        if all(name.endswith(".npy") for name in archive.zip.namelist()):  # PyTorch's are zip files too
            return {name: archive[name] for name in archive.files}
    except Exception:  # no archive, or a damaged one: numpy and zipfile raise many types
        pass
    import torch
    try:
        state = torch.load(path, map_location="cpu")
    except Exception as error:  # torch raises many types for a file it cannot read
        fail(path, f"is neither an intact .npz file nor a PyTorch file: {error}")
    if not isinstance(state, Mapping) or not all(torch.is_tensor(value) for value in state.values()):
        fail(path, "not a state dict; save it with torch.save(model.state_dict())")
    return {name: value.numpy() for name, value in state.items()}


def checked(path, arrays):
    """The arrays without `module.` prefixes (multi-GPU training); every name and shape has to match."""
    arrays = {name[7:] if name.startswith("module.") else name: value for name, value in arrays.items()}
    expected = {name: tuple(value.shape) for name, value in EslNet().state_dict().items()}
    for name, shape in expected.items():
        if name not in arrays:
            fail(path, f"lacks the array '{name}': not eSL-Net without super-resolution")
        if arrays[name].shape != shape:
            fail(path, f"array '{name}' is {list(arrays[name].shape)}, expected {list(shape)}")
        if arrays[name].dtype.kind != "f" or not np.isfinite(arrays[name]).all():
            fail(path, f"array '{name}' is not of finite numbers")
    unknown = sorted(set(arrays) - set(expected))
    if unknown:
        fail(path, f"unknown array '{unknown[0]}' ({len(unknown)} of them): "
                   "not eSL-Net without super-resolution")
    return {name: arrays[name] for name in expected}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("weights", help="state dict (.pt) or its arrays under the same names (.npz)")
    parser.add_argument("-o", "--output", required=True, help="safetensors file to write")
    args = parser.parse_args()
    arrays = checked(args.weights, read_arrays(args.weights))
    try:
        export_esl_net(args.output, arrays, "published weights, imported")
    except OSError as error:
        sys.exit(f"import_esl_net: cannot write {args.output}: {error.strerror}")


if __name__ == "__main__":
    main()
