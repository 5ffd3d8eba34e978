"""The results as Markdown tables."""
from methods import FEW_FRAMES, FRAMES, REFERENCE

ABLATION = ("name", "inputs", "output", "refined", "seed", "steps", "nrmse", "psnr", "ssim")


def table(header, rows, text=1):
    """Markdown; the first `text` columns are text, the others figures."""
    lines = ["| " + " | ".join(header) + " |", "|" + " --- |" * text + " ---: |" * (len(header) - text)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows]) + "\n"


def number(value, digits=2, sign=False):
    """A figure, or a dash where there is none."""
    if value is None:
        return "–"
    return f"{value:{'+' if sign else ''}.{digits}f}"


def _margin(row):
    if "margin_psnr" not in row:
        return "–"
    return f"{number(row['margin_psnr'], sign=True)} / {number(row['margin_ssim'], 3, sign=True)}"


def _pair(row):
    return f"{number(row['psnr'])} / {number(row['ssim'], 3)}" if row else "–"


def _count(value, unit):
    if value is None:
        return "–"
    return f"{value / unit:.3g}" if value < 1000 * unit else f"{value / unit:.0f}"


def accuracy_summary(rows, methods):
    """Methods down, bands across."""
    methods = [method for method in methods if method.name in rows[-1]["methods"]]
    header = ["travel, px"] + [f"{row['band']} ({row['methods']['blurry']['scenes']})" for row in rows]
    return table(header, [[method.label] + [_pair(row["methods"].get(method.name)) for row in rows]
                          for method in methods])


def accuracy_details(rows, methods):
    body = []
    for row in rows:
        for method in methods:
            figures = row["methods"].get(method.name)
            if figures:
                body.append([row["band"], method.label, str(figures["scenes"])]
                            + [f"{number(figures[key], digits)} ± {number(figures[key + '_sd'], digits)}"
                               for key, digits in (("nrmse", 3), ("psnr", 2), ("ssim", 3))]
                            + [_margin(figures) if method.name != REFERENCE else "–"])
    return table(["travel, px", "method", "scenes", "NRMSE", "PSNR, dB", "SSIM", "margin, dB / SSIM"], body, 2)


def costs(rows, methods, cost):
    body = [[method.label, _count(cost[method.name]["parameters"], 1e6), _count(cost[method.name]["gmac"], 1),
             _pair(rows[-1]["methods"].get(method.name))] for method in methods if method.model]
    return table(["method", "parameters, millions", f"GMAC for {FRAMES} frames", "PSNR / SSIM, all bands"], body)


def robust_label(method):
    """In the robustness table the row says where EDI's thresholds come from."""
    return "EDI" if method.name == "edi" else method.label


def robustness(rows, methods, flagship):
    fast = [method for method in methods if method.name in rows[0]["methods"]]
    header = ["sensor", *(robust_label(method) for method in fast)]
    body = []
    for row in rows:
        flag = " **below EDI**" if row["below_edi"] else ""
        body.append([row["label"] + flag] + [_pair(row["methods"][method.name]) for method in fast])
    text = table(header, body)
    if any(method.name == flagship for method in fast):
        below = sum(row["below_edi"] for row in rows)
        text += (f"\n`{flagship}` is below EDI in PSNR or SSIM in {below} of {len(rows)} rows.\n")
    few = [row for row in rows if row["few"]]
    if few:
        used = [method for method in methods if method.name in few[0]["few"]]
        text += (f"\nThe same on the {few[0]['few']['blurry']['scenes']} scenes and {len(FEW_FRAMES)} frames "
                 "of an exposure that eSL-Net was run on:\n\n")
        text += table(["sensor", *(robust_label(method) for method in used)],
                      [[row["label"]] + [_pair(row["few"][method.name]) for method in used] for row in few])
    return text


def knowledge(methods):
    """What each method knows of the contrast thresholds."""
    told = ", ".join(robust_label(m) for m in methods if m.takes_threshold and m.name != REFERENCE)
    assumed = ", ".join(m.label for m in methods if m.architecture in ("ecir", "esl_net"))
    text = (f"Thresholds: in the rows with `told` they are given to {told}; in all other rows these estimate them "
            "from the frame and its events.")
    return text + (f" {assumed} have no such input: they assume what they were trained around, in every row, so "
                   "`told` changes nothing for them.\n" if assumed else "\n")


def capture(figures, methods, part):
    body = []
    for method in methods:
        row = figures.get(method.name, {}).get(part)
        if row:
            still = method.architecture == "blurry"
            body.append([method.label, str(row["exposures"])]
                        + [number(None if still and key != "gradient" else row[key], digits)
                           for key, digits in (("reblur", 2), ("agreement", 3), ("gradient", 3), ("ghosts", 2))])
    return table(["method", "exposures", "re-blur error, grey levels", "event agreement", "gradient ratio",
                  "end-to-end difference, grey levels"], body)


def ablation(rows):
    body = [[str(row["name"]), str(row["inputs"]), str(row["output"]), "yes" if row["refined"] else "no",
             str(row["seed"]), str(row["steps"]), number(row["nrmse"], 3), number(row["psnr"]), number(row["ssim"], 3)]
            for row in rows]
    return table(["row", "inputs", "output", "refined", "seed", "steps", "NRMSE", "PSNR, dB", "SSIM"], body, 4)


def markdown(results, methods):
    """The whole report; results is what results.json holds."""
    settings, parts = results["settings"], ["# Benchmark\n"]
    parts.append(f"`{settings['command']}`\n")
    parts += [f"- {note}" for note in results["notes"]] + [""] * bool(results["notes"])
    if "accuracy" in results:
        rows = results["accuracy"]
        parts += [
            "## Accuracy on simulated scenes\n",
            f"{settings['size']} pixels, {FRAMES} frames an exposure, seed {settings['seed']}, scene thresholds 0.12 "
            "to 0.35 unknown to every method but `best single threshold`, which is the threshold (one for both signs) "
            "of the highest mean PSNR of the scene, chosen knowing the truth. Figures of 8-bit frames, means over "
            "frames, then over scenes; travel is the length of the background's translation path over the exposure.\n",
            "PSNR in dB / SSIM (scenes):\n", accuracy_summary(rows, methods),
            "![accuracy by travel](accuracy.png)\n",
            "Mean ± standard deviation over scenes; margin over EDI with the best single threshold:\n",
            accuracy_details(rows, methods),
            "Parameters and operations (multiply-adds of the convolutions, counted from the weights' shapes):\n",
            costs(rows, methods, results["cost"])]
        if results["few"]:
            few = results["few"]
            parts += ["### Beside eSL-Net\n", "The scenes and the three frames of an exposure (first, middle, last) "
                      "that eSL-Net was run on, for all methods. PSNR in dB / SSIM (scenes):\n",
                      accuracy_summary(few, methods), accuracy_details(few, methods)]
    if "robustness" in results:
        parts += ["## Robustness\n",
                  f"PSNR in dB / SSIM, means over {results['robustness'][0]['methods']['blurry']['scenes']} scenes "
                  "of all travel bands, the same motion in each row.\n",
                  robustness(results["robustness"], methods, settings["flagship"]), knowledge(methods),
                  "![robustness](robustness.png)\n"]
    if "ablation" in results:
        parts += ["## Ablation\n", ablation(results["ablation"])]
    for name, figures in results.get("captures", {}).items():
        parts += [
            f"## Real capture {name}\n",
            "Re-blur error: RMS between the mean of 29 rendered frames and the captured frame. Event agreement: "
            f"correlation of the change of ln(I + 0.01) between neighbours of {FRAMES} frames with the events' signed "
            "count, both smoothed by 1 pixel. Gradient ratio: RMS gradient at mid-exposure after a Gaussian of 1 "
            "pixel, over the captured frame's. End-to-end difference: RMS between the last frame of an exposure and "
            "the first of the next, translation undone: ghosts, grain, and what moved in between.\n",
            capture(figures, methods, "all")]
        if any(figures[m.name]["all"] is None for m in methods if m.name in figures):
            parts += ["With frames at t = -1, 0, 1 only, on the exposures that eSL-Net was run on:\n",
                      capture(figures, methods, "coarse")]
        parts.append(f"![{name}](captures/{name}.png)\n")
    return "\n".join(parts)
