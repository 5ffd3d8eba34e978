"""Charts of the results, PNG and SVG."""
import os

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt     # noqa: E402 (after the choice of the back end)

from report import robust_label     # noqa: E402

COLOURS = ("#888888", "#e69f00", "#b35900", "#009e73", "#56b4e9", "#0072b2", "#cc3377", "#000000", "#7b5cc4")
MARKERS = "sDv^<oP*X"
LABELS = {"psnr": "PSNR, dB", "ssim": "SSIM"}


def _style(methods, method):
    place = [m.name for m in methods].index(method.name) % len(COLOURS)
    return {"color": COLOURS[place], "marker": MARKERS[place]}


def _save(figure, folder, name):
    for kind in ("png", "svg"):
        figure.savefig(os.path.join(folder, f"{name}.{kind}"), dpi=130)
    plt.close(figure)


def _legend(figure, axes):
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper center", ncol=min(4, len(labels)), frameon=False, fontsize=9)


def accuracy(rows, methods, folder):
    """PSNR and SSIM against travel; bars: standard deviation over scenes."""
    bands = [row for row in rows if row["band"] != "all"]
    shown = [method for method in methods if method.name in bands[0]["methods"]]
    figure, panels = plt.subplots(1, 2, figsize=(11, 5))
    for axes, key in zip(panels, LABELS):
        for i, method in enumerate(shown):
            figures = [row["methods"][method.name] for row in bands]
            # Side by side, so that bars do not hide one another.
            x = [k + 0.07 * (i - (len(shown) - 1) / 2) for k in range(len(bands))]
            axes.errorbar(x, [f[key] for f in figures], [f[key + "_sd"] for f in figures], label=method.label,
                          linewidth=1.5, markersize=6, elinewidth=0.7, capsize=2, **_style(methods, method))
        axes.set_xticks(range(len(bands)), [row["band"] for row in bands])
        axes.set_xlabel("travel, pixels an exposure")
        axes.set_ylabel(LABELS[key])
        axes.grid(axis="y", color="#dddddd")
    _legend(figure, panels[0])
    figure.tight_layout(rect=(0, 0, 1, 0.9))
    _save(figure, folder, "accuracy")


def robustness(rows, methods, folder):
    """One line a condition, one mark a method."""
    shown = [method for method in methods if method.name in rows[0]["methods"]]
    figure, panels = plt.subplots(1, 2, figsize=(12, 1.6 + 0.42 * len(rows)), sharey=True)
    for axes, key in zip(panels, LABELS):
        for method in shown:
            axes.plot([row["methods"][method.name][key] for row in rows], range(len(rows)), linestyle="none",
                      markersize=7, label=robust_label(method), **_style(methods, method))
        axes.set_yticks(range(len(rows)), [row["label"] for row in rows])
        axes.set_xlabel(LABELS[key])
        axes.grid(color="#dddddd")
    panels[0].invert_yaxis()
    _legend(figure, panels[0])
    figure.tight_layout(rect=(0, 0, 1, 0.9))
    _save(figure, folder, "robustness")
