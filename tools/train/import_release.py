#!/usr/bin/env python3
"""Published PyTorch weights (two state dicts) as one safetensors file of the `release` variant."""
import argparse
import sys
from collections.abc import Mapping

import torch

from export import model_metadata, model_tensors, write_safetensors
from model import RELEASE, RELEASE_INTERVALS, ECIR


def read_state(path):
    """State dict of a .pth file, `module.` prefixes (multi-GPU training) taken off."""
    try:
        state = torch.load(path, map_location="cpu")
    except Exception as error:  # torch raises many types for a file it cannot read
        sys.exit(f"import_release: {path}: cannot be read as a PyTorch file: {error}")
    if not isinstance(state, Mapping) or not all(torch.is_tensor(v) for v in state.values()):
        sys.exit(f"import_release: {path}: not a state dict; save it with torch.save(model.state_dict())")
    return {name[7:] if name.startswith("module.") else name: value for name, value in state.items()}


def load_part(module, state, path):
    """Fills the module; every name and shape has to match."""
    expected = {name: value for name, value in module.state_dict().items()
                if not name.endswith("num_batches_tracked")}
    state = {name: value for name, value in state.items() if not name.endswith("num_batches_tracked")}
    for name, value in expected.items():
        if name not in state:
            sys.exit(f"import_release: {path}: lacks tensor '{name}' (are the two files swapped?)")
        if state[name].shape != value.shape:
            sys.exit(f"import_release: {path}: tensor '{name}' is {list(state[name].shape)}, "
                     f"expected {list(value.shape)}")
    unknown = sorted(set(state) - set(expected))
    if unknown:
        sys.exit(f"import_release: {path}: unknown tensor '{unknown[0]}' "
                 f"({len(unknown)} of them): not the published network")
    module.load_state_dict(state, strict=False)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("model_g", help="state dict of the U-Net (.pth)")
    parser.add_argument("model_r", help="state dict of the refinement (.pth)")
    parser.add_argument("-o", "--output", required=True, help="safetensors file to write")
    parser.add_argument("--iterations", type=int, default=3, help="refinement iterations (published: 3)")
    parser.add_argument("--span", type=float, default=1.0,
                        help="half width of the 14 edges in normalised time (default 1)")
    args = parser.parse_args()
    if args.iterations < 0 or not 0 < args.span <= 1:
        parser.error("--iterations must not be negative, --span must be in (0, 1]")

    unet = read_state(args.model_g)
    first, last = unet.get("en_conv1.0.weight"), unet.get("pred.weight")
    if first is None or last is None or first.dim() != 4 or last.dim() != 4:
        sys.exit(f"import_release: {args.model_g}: lacks 'en_conv1.0.weight' or 'pred.weight' "
                 "(are the two files swapped?)")
    model = ECIR(RELEASE, first.shape[0], 2 * RELEASE_INTERVALS, last.shape[0], args.iterations)
    load_part(model.unet, unet, args.model_g)
    load_part(model.refine, read_state(args.model_r), args.model_r)
    more = {"training": "published weights, imported from two PyTorch state dicts"}
    if args.span != 1.0:
        more["span"] = repr(args.span)
    try:
        write_safetensors(args.output, model_tensors(model), model_metadata(model, **more))
    except OSError as error:
        sys.exit(f"import_release: cannot write {args.output}: {error.strerror}")


if __name__ == "__main__":
    main()
