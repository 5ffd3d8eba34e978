#!/usr/bin/env python3
"""How close EDI with estimated thresholds comes to EDI with the best ones chosen knowing the truth.

Simulates scenes from photographs with unknown thresholds (0.12 to 0.35, the signs up to 20 % apart), by
travel, deblurs each with `ecir deblur -m edi`, once estimating and over a grid of given thresholds, and
prints the mean PSNR of each and the gaps.
"""
import argparse
import json
import pathlib
import random
import subprocess
import sys
import tempfile

BANDS = ((4, 15), (15, 30), (30, 60), (60, 90))


def run(*command):
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"edi_thresholds: {' '.join(map(str, command))}\n{done.stderr}")
    return done.stdout


class Scene:
    """One simulated exposure in a folder of its own."""

    def __init__(self, ecir, photo, folder, rng, band):
        self.ecir, self.folder = ecir, folder
        mean = rng.uniform(0.12, 0.35)
        apart = rng.uniform(1 / 1.1, 1.1)
        self.best = {}
        run(ecir, "simulate", "-i", photo, "-o", folder / "scene", "--travel", rng.uniform(*band),
            "--angle", rng.uniform(0, 360), "--rotate", rng.uniform(-3, 3),
            "--motion", rng.choice(["linear", "reverse", "shake"]),
            "--threshold", mean * apart, mean / apart, "--seed", rng.randrange(1 << 30))

    def psnr(self, prediction):
        return json.loads(run(self.ecir, "eval", "--truth", self.folder / "scene/truth",
                              "--prediction", prediction, "--json"))["psnr"]

    def edi(self, *thresholds):
        """PSNR with the thresholds, or with estimated ones."""
        if thresholds not in self.best:
            option = ["--threshold", *thresholds] if thresholds else []
            run(self.ecir, "deblur", "-i", self.folder / "scene", "-o", self.folder / "sharp.npy",
                "-m", "edi", "--overwrite", *option)
            self.best[thresholds] = self.psnr(self.folder / "sharp.npy")
        return self.best[thresholds]

    def blurry(self):
        copies = self.folder / "blurry"
        copies.mkdir()
        for frame in (self.folder / "scene/truth").iterdir():
            (copies / frame.name).write_bytes((self.folder / "scene/blurry_000000.png").read_bytes())
        return self.psnr(copies)

    def oracle(self):
        """The best PSNR over pairs: a grid of sizes and ratios, then a finer one around the best."""
        def search(sizes, ratios):
            pairs = [(c * r**0.5, c / r**0.5) for c in sizes for r in ratios]
            return max(pairs, key=lambda pair: self.edi(*pair))
        up, down = search([0.09 * 1.22**i for i in range(9)], (0.83, 1.0, 1.21))
        size, ratio = (up * down)**0.5, up / down
        return self.edi(*search([size * f for f in (0.93, 1.0, 1.07)],
                                [ratio * f for f in (0.91, 1.0, 1.1)]))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--ecir", default="build/demo/ecir", help="the tool")
    parser.add_argument("--images", required=True, help="folder of photographs")
    parser.add_argument("--scenes", type=int, default=6, help="for each band of travel")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    photos = sorted(p for p in pathlib.Path(args.images).iterdir() if p.suffix in (".png", ".jpg"))
    if not photos:
        sys.exit(f"edi_thresholds: {args.images}: no .png or .jpg in this folder")
    print("| travel, px | blurry | best thresholds | estimated | mean gap | largest gap |\n"
          "| --- | --- | --- | --- | --- | --- |")
    for band in BANDS:
        rng = random.Random(args.seed * 1000 + band[0])
        rows = []
        for _ in range(args.scenes):
            with tempfile.TemporaryDirectory() as folder:
                scene = Scene(args.ecir, rng.choice(photos), pathlib.Path(folder), rng, band)
                rows.append((scene.blurry(), scene.oracle(), scene.edi()))
        blurry, oracle, estimated = (sum(column) / len(rows) for column in zip(*rows))
        largest = max(best - found for _, best, found in rows)
        print(f"| {band[0]}-{band[1]} | {blurry:.2f} | {oracle:.2f} | {estimated:.2f} "
              f"| {oracle - estimated:.2f} | {largest:.2f} |", flush=True)


if __name__ == "__main__":
    main()
