#!/usr/bin/env python3
"""What `ecir deblur` saves where only a part of the image moves, and what that costs in accuracy.

Makes scenes from the two photographs with most texture: over a background that stands still a textured object moves, and both together
cover a share of the image (100: the background itself moves; 0: nothing, the sensor's noise alone). Each is
simulated with `ecir simulate` and deblurred with --regions on and off. Times are of preparing and computing one exposure,
the median over a recording of seven, so that starting up and windows of a new size do not count.

example:
  tools/regions.py --images PHOTOS --ecir build/dev/ecir
"""
import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile

try:
    import cv2
    import numpy as np
except ImportError as error:
    sys.exit(f"regions: {error}; Debian's packages are python3-opencv and python3-numpy, of /usr/bin/python3")

FPS, EXPOSURE_US, EXPOSURES = 1000, 50_000, 7
THRESHOLD = 0.18    # of the sensor; given to the models that take it, since estimating it is a start's work
TRAVEL = 16     # pixels an exposure


def run(*command):
    """Standard output."""
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"regions: {' '.join(map(str, command))}\n{done.stderr}")
    return done.stdout


def photo(path, width, height):
    """Grey picture, mirrored at its sides to fill width x height, float32."""
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        sys.exit(f"regions: {path} is no picture")
    rows, columns = image.shape
    grown = np.pad(image, ((0, max(0, height - rows)), (0, max(0, width - columns))), "symmetric")
    return grown[:height, :width].astype(np.float32)


def texture(path):
    """How much there is to see moving: mean size of the gradient."""
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    return 0.0 if image is None else float(np.mean(np.abs(np.diff(image.astype(np.float32)))))


def draw(folder, photos, size, share):
    """Sharp frames of the scene, share in per cent."""
    width, height = size
    way = TRAVEL * EXPOSURES
    background = photo(photos[0], width + way, height)
    # The moving part of one exposure: as wide as the object and its way.
    room = share / 100 * width * height
    tall = min(height, round((room * height / width) ** 0.5))
    wide = round(room / tall) - TRAVEL if share else 0
    left, top = (width - wide - way) // 2 + 5, (height - tall) // 2 + 3
    thing = photo(photos[1], wide, tall) if share and share < 100 else None
    for i in range(EXPOSURES * EXPOSURE_US * FPS // 1_000_000 + 1):
        shift = i * TRAVEL * 1e6 / FPS / EXPOSURE_US
        if share == 100:
            frame = cv2.warpAffine(background, np.float32([[1, 0, shift - way], [0, 1, 0]]), size)
        else:
            frame = background[:, :width].copy()
        if thing is not None:
            move = np.float32([[1, 0, left + shift], [0, 1, top]])
            alpha = cv2.warpAffine(np.ones_like(thing), move, size)
            frame += alpha * (cv2.warpAffine(thing, move, size, borderMode=cv2.BORDER_REPLICATE) - frame)
        cv2.imwrite(str(folder / f"{i:06}.png"), np.round(np.clip(frame, 0, 255)).astype(np.uint8))


def make_scenes(args, photos, share, folder):
    """Recordings of one exposure and of EXPOSURES; the sharp frames lie in the first one."""
    frames = folder / "frames"
    frames.mkdir()
    draw(frames, photos, args.size, share)
    scene, first = folder / "all", folder / "first"
    run(args.ecir, "simulate", "-i", frames, "-o", scene, "--fps", FPS, "--size", "{}x{}".format(*args.size),
        "--exposure-us", EXPOSURE_US, "--count", EXPOSURES, "--frames", args.frames, "--noise", args.noise,
        "--threshold", THRESHOLD, "--threshold-sigma", 0.03)
    first.mkdir()
    for name in ("events.h5", "blurry_000000.png"):
        os.link(scene / name, first / name)
    table = (scene / "exposures.csv").read_text().splitlines()
    (first / "exposures.csv").write_text("\n".join(table[:2]) + "\n")
    return first, scene


def deblur(args, scene, output, regions):
    """Seconds an exposure."""
    threshold = ("--threshold", THRESHOLD) if args.model in ("edi", "fusion") else ()
    report = output.with_suffix(".json")
    run(args.ecir, "deblur", "-i", scene, "-o", output, "-m", args.model, "--frames", args.frames,
        "--regions", regions, "--report", report, *threshold)
    stages = [exposure["ms"] for exposure in json.loads(report.read_text())["exposures"]]
    return statistics.median(stage["prepare"] + stage["wait"] for stage in stages) / 1000


def psnr(args, truth, prediction):
    """dB, as text; eval gives none where every frame is the truth."""
    found = json.loads(run(args.ecir, "eval", "--truth", truth, "--prediction", prediction, "--json"))["psnr"]
    return "exact" if found is None else f"{found:.3f}"


def measure(args, photos, share):
    """Seconds an exposure and PSNR with regions; PSNR without; their largest difference in grey levels."""
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        first, scene = make_scenes(args, photos, share, folder)
        truth = sorted((scene / "truth").iterdir())[0]
        seconds = deblur(args, scene, folder / "all.npy", "on")
        deblur(args, first, folder / "on.npy", "on")
        deblur(args, first, folder / "off.npy", "off")
        on, off = (np.load(folder / f"{mode}.npy") for mode in ("on", "off"))
        return seconds, psnr(args, truth, folder / "on.npy"), psnr(args, truth, folder / "off.npy"), \
            255 * float(np.abs(on - off).max())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ecir", default="build/demo/ecir", help="the tool [%(default)s]")
    parser.add_argument("--images", required=True, help="folder of photographs")
    parser.add_argument("--size", default="1280x720", help="WxH [%(default)s]")
    parser.add_argument("--shares", type=int, nargs="+", default=[0, 5, 25, 50, 100], help="per cent [%(default)s]")
    parser.add_argument("--frames", type=int, default=5, help="an exposure [%(default)s]")
    parser.add_argument("--noise", type=float, default=0.1, help="background events a second and pixel [%(default)s]")
    parser.add_argument("-m", "--model", default="fusion", help="[%(default)s]")
    args = parser.parse_args()
    args.size = tuple(int(side) for side in args.size.split("x"))
    photos = sorted(p for p in pathlib.Path(args.images).iterdir() if p.suffix in (".png", ".jpg"))
    if len(photos) < 2:
        sys.exit(f"regions: {args.images}: fewer than two .png or .jpg in this folder")
    photos.sort(key=texture, reverse=True)
    print("| moving, % | time of an exposure, s | PSNR, dB | whole image computed | largest difference, grey levels |\n"
          "| --- | --- | --- | --- | --- |")
    for share in args.shares:
        seconds, on, off, difference = measure(args, photos, share)
        print(f"| {share} | {seconds:.2f} | {on} | {off} | {difference:.3f} |", flush=True)


if __name__ == "__main__":
    main()
