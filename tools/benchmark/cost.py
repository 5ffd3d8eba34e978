"""Parameters and multiply-adds of a network, from the shapes in its weights file.

Multiply-adds of the convolutions alone, borders counted as inside, for one exposure. `ecir` does not
print its kernels' counts, so a rule for each layer says at which size and how often it runs.
"""
import re
from math import ceil, prod

from methods import FRAMES, BenchmarkError, read_header

ESL_ROUNDS = 25
REFERENCES = 1  # -1 and 1 are among even times, 0 is where their number is odd


def _ecir_rules(metadata, frames, refined):
    """(pattern, side of its cells in pixels, runs). Transposed convolutions run once an input cell."""
    rounds = int(metadata.get("iterations", 3)) if refined else 0
    rules = [(rf"unet\.en_conv{i}\.", 2 ** i, 1) for i in range(1, 5)]
    rules += [(rf"unet\.de_conv{i}\.", 2 ** (5 - i), 1) for i in range(1, 5)]
    return rules + [(r"unet\.res", 16, 1), (r"unet\.pred", 1, 1),
                    (r"refine\.first_res_net", 1, rounds), (r"refine\.other_res_net", 1, rounds * (frames - 2)),
                    (r"refine\.alpha_net", 1, rounds * frames), (r"refine\.final", 1, frames if refined else 0)]


def _esl_rules(_metadata, frames, _refined):
    return [(r"\.S[12]\.", 1, ESL_ROUNDS * frames), (r"image_d|event_c|W1|W2|endconv", 1, frames)]


def _fusion_rules(_metadata, frames, refined):
    """By the modules of tools/train/fusion.py and what the refinement across time adds."""
    trunk = {2: "down1", 4: "down2|res2|res7|feature", 8: "down3|res3|motion|res6|up2", 16: "down4|res4|res5|up3"}
    head = {1: "skip|out", 2: "down1|res1|up0", 4: "down2|res2|res3|up1"}
    return ([(rf"trunk\.({layers})\.", side, 1) for side, layers in trunk.items()]
            + [(rf"head\.({layers})\.", side, frames + (REFERENCES if refined else 0)) for side, layers in head.items()])


RULES = {"ecir": _ecir_rules, "esl_net": _esl_rules, "fusion": _fusion_rules}


def multiply_adds(metadata, shapes, size, frames, refined=True):
    """Of one exposure of size (H, W); BenchmarkError for a convolution without a rule."""
    if metadata.get("model") not in RULES:
        raise BenchmarkError(f"no rule for a model '{metadata.get('model')}'")
    rules, total = RULES[metadata["model"]](metadata, frames, refined), 0
    for name, shape in shapes.items():
        if len(shape) != 4:
            continue
        rule = next((rule for rule in rules if re.search(rule[0], name)), None)
        if rule is None:
            raise BenchmarkError(f"no rule for {name}")
        total += prod(shape) * ceil(size[0] / rule[1]) * ceil(size[1] / rule[1]) * rule[2]
    return total


def cost(method, size):
    """{"parameters", "gmac", "note"} of a method for FRAMES frames; the note says why there is no gmac."""
    if not method.model.endswith(".safetensors"):
        return {"parameters": 0, "gmac": None, "note": None}
    metadata, shapes = read_header(method.model)
    refined = "--refine" not in method.options
    counted = [shape for name, shape in shapes.items()
               if "running_" not in name and "num_batches" not in name
               and (refined or not name.startswith("refine."))]
    gmac, note = None, None
    try:
        gmac = multiply_adds(metadata, shapes, size, FRAMES, refined) / 1e9
    except BenchmarkError as error:
        note = f"{method.label}: operations not counted, cost.py has {error}"
    return {"parameters": sum(map(prod, counted)), "gmac": gmac, "note": note}
