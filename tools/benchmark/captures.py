"""Real captures, for which there is no truth: measures that need none, and a strip to look at."""
import csv
import glob
import json
import os
import tempfile
from dataclasses import dataclass

import cv2
import h5py
import numpy as np

import reference_free as measures
from cache import file_hash
from methods import FRAMES, BenchmarkError
from metrics import to_codes

REBLUR_FRAMES = 29
STRIP_TIMES = (-1.0, -0.5, 0.0, 0.5, 1.0)
COARSE_TIMES = (-1.0, 0.0, 1.0)     # of slow methods, and of the others beside them
COARSE_EXPOSURES = 3


@dataclass(frozen=True)
class Exposure:
    file: str
    start: int      # microseconds
    end: int


class Capture:
    """A folder with images, events.h5, and exposures.csv or meta.json."""

    def __init__(self, folder):
        self.folder, self.name = os.path.abspath(folder), os.path.basename(os.path.abspath(folder))
        try:
            listed = self._listed()
            with h5py.File(os.path.join(folder, "events.h5")) as file:
                offset = int(file["t_offset"][()]) if "t_offset" in file else 0
                self.t, self.x, self.y, self.p = (file["events/" + name][:].astype(np.int64) for name in "txyp")
                self.t += offset
        except (OSError, KeyError, ValueError) as error:
            raise BenchmarkError(f"capture '{folder}': {error}") from error
        # An exposure that saw nothing has nothing to tell.
        self.exposures = [e for e in listed if self._count(e)]
        if not self.exposures:
            raise BenchmarkError(f"capture '{folder}': no events in any exposure")
        self.images = [self._image(e) for e in self.exposures]
        self.busiest = max(range(len(self.exposures)), key=lambda i: self._count(self.exposures[i]))
        first = max(0, min(self.busiest - COARSE_EXPOSURES // 2, len(self.exposures) - COARSE_EXPOSURES))
        self.coarse = list(range(first, min(first + COARSE_EXPOSURES, len(self.exposures))))

    def _listed(self):
        path = os.path.join(self.folder, "exposures.csv")
        if os.path.exists(path):
            with open(path, newline="", encoding="utf-8") as file:
                return [Exposure(row["file"], int(row["start_us"]), int(row["end_us"]))
                        for row in csv.DictReader(file)]
        with open(os.path.join(self.folder, "meta.json"), encoding="utf-8") as file:
            return [Exposure(frame["file"], frame["exposure_start_us"], frame["exposure_end_us"])
                    for frame in json.load(file)["frames"]]

    def _count(self, exposure):
        return int(np.searchsorted(self.t, exposure.end, "right") - np.searchsorted(self.t, exposure.start))

    def _image(self, exposure):
        image = cv2.imread(os.path.join(self.folder, exposure.file), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise BenchmarkError(f"capture '{self.folder}': {exposure.file} is not a readable image")
        return image.astype(np.float64) / 255

    def identity(self):
        files = sorted(filter(os.path.isfile, glob.glob(os.path.join(self.folder, "*"))))
        return file_hash(*files, measures.__file__, __file__)

    def write_recording(self, chosen, folder):
        """The chosen exposures as `ecir deblur -i FOLDER` reads them."""
        os.symlink(os.path.join(self.folder, "events.h5"), os.path.join(folder, "events.h5"))
        with open(os.path.join(folder, "exposures.csv"), "w", newline="", encoding="utf-8") as file:
            table = csv.writer(file)
            table.writerow(("file", "start_us", "end_us"))
            for exposure in (self.exposures[i] for i in chosen):
                table.writerow((exposure.file, exposure.start, exposure.end))
                os.symlink(os.path.join(self.folder, exposure.file), os.path.join(folder, exposure.file))

    def frames(self, ecir, method, chosen, times):
        """[exposures, times, H, W], clipped to [0, 1]."""
        if method.architecture == "blurry":
            return np.stack([np.repeat(self.images[i][None], len(times), 0) for i in chosen])
        with tempfile.TemporaryDirectory() as folder:
            self.write_recording(chosen, folder)
            found = ecir.deblur(folder, method, "--times", *times)
        return found.clip(0, 1).reshape((len(chosen), len(times)) + found.shape[1:])


def _mean(values):
    values = [value for value in values if value is not None]
    return float(np.mean(values)) if values else None


def agreement(capture, chosen, frames, times):
    """Mean event agreement over neighbouring times and exposures."""
    values = []
    for i, rendered in zip(chosen, frames):
        exposure = capture.exposures[i]
        edges = exposure.start + (np.asarray(times) + 1) / 2 * (exposure.end - exposure.start)
        edges[-1] += times[-1] == 1     # the exposure's last microsecond belongs to it
        for k in range(len(times) - 1):
            count = measures.event_image(capture.t, capture.x, capture.y, capture.p, edges[k], edges[k + 1],
                                         rendered.shape[1:])
            values.append(measures.event_agreement(rendered[k], rendered[k + 1], count))
    return _mean(values)


def sharpness(capture, chosen, middle):
    return _mean([measures.gradient(frame) / max(measures.gradient(capture.images[i]), 1e-9)
                  for i, frame in zip(chosen, middle)])


def ghosts(chosen, frames):
    """Mean over neighbouring exposures."""
    return _mean([measures.ghost_error(frames[k][-1], frames[k + 1][0])
                  for k in range(len(chosen) - 1) if chosen[k + 1] == chosen[k] + 1])


def evaluate_capture(ecir, cache, capture, method, output):
    """{"all", "coarse"}: figures over all exposures and over the few of slow methods; frames of the
    strip go to a file in output."""
    strip_file = os.path.join(output, f"{capture.name}-{method.name.replace(':', '-')}.png")
    key = {"capture": capture.identity(), "method": method.identity(ecir)}
    found = cache.get(key)
    if found is not None and os.path.exists(strip_file):
        return found
    coarse = capture.coarse
    found = {"all": None}
    if method.slow:
        few = capture.frames(ecir, method, coarse, COARSE_TIMES)
        strip = {time: few[coarse.index(capture.busiest), k] for k, time in enumerate(COARSE_TIMES)}
    else:
        every = list(range(len(capture.exposures)))
        fine_times = np.linspace(-1, 1, REBLUR_FRAMES)
        fine = capture.frames(ecir, method, every, fine_times)
        found["all"] = {
            "exposures": len(every),
            "reblur": _mean([measures.reblur_error(fine[i], capture.images[i]) for i in every]),
            "gradient": sharpness(capture, every, fine[:, REBLUR_FRAMES // 2]),
            "ghosts": ghosts(every, fine)}
        places = [int(np.argmin(np.abs(fine_times - time))) for time in (*COARSE_TIMES, *STRIP_TIMES)]
        few = fine[np.ix_(coarse, places[:len(COARSE_TIMES)])]
        strip = {time: fine[capture.busiest, place] for time, place in zip(STRIP_TIMES, places[len(COARSE_TIMES):])}
        del fine
        times = np.linspace(-1, 1, FRAMES)
        found["all"]["agreement"] = agreement(capture, every, capture.frames(ecir, method, every, times), times)
    found["coarse"] = {"exposures": len(coarse), "reblur": None,
                       "agreement": agreement(capture, coarse, few, COARSE_TIMES),
                       "gradient": sharpness(capture, coarse, few[:, 1]), "ghosts": ghosts(coarse, few)}
    blank = np.full(capture.images[0].shape, 1.0)
    row = [to_codes(strip.get(time, blank)) for time in STRIP_TIMES]
    if not cv2.imwrite(strip_file, np.concatenate(row, 1)):
        raise BenchmarkError(f"cannot write {strip_file}")
    cache.put(key, found)
    return found


def write_strip(capture, methods, folder, path):
    """One row a method: the captured frame and the method's at STRIP_TIMES, of the busiest exposure."""
    captured = to_codes(capture.images[capture.busiest])
    height, width = captured.shape
    head, side, gap = 28, 250, 4
    rows = [np.full((head, side + (len(STRIP_TIMES) + 1) * (width + gap)), 255, np.uint8)]

    def write(image, text, x, y):
        cv2.putText(image, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, 0.5, 0, 1, cv2.LINE_AA)
    for k, text in enumerate(("captured frame", *(f"t = {time:g}" for time in STRIP_TIMES))):
        write(rows[0], text, side + k * (width + gap) + 4, 19)
    for method in methods:
        if method.architecture == "blurry":
            continue
        frames = cv2.imread(os.path.join(folder, f"{capture.name}-{method.name.replace(':', '-')}.png"),
                            cv2.IMREAD_GRAYSCALE)
        row = np.full((height + gap, rows[0].shape[1]), 255, np.uint8)
        write(row, method.label, 6, height // 2)
        for k, frame in enumerate((captured, *np.split(frames, len(STRIP_TIMES), 1))):
            row[:height, side + k * (width + gap):][:, :width] = frame
        rows.append(row)
    cv2.imwrite(path, np.concatenate(rows))
