"""Measures of sharp frames that need no truth. Frames are [0, 1] floats [H, W]."""
import cv2
import numpy as np

LOG_EPS = 0.01          # of ln(I + eps)
SMOOTHING = 1.0         # pixels, standard deviation


def smooth(image):
    return cv2.GaussianBlur(np.asarray(image, np.float64), (0, 0), SMOOTHING)


def rms(image):
    return float(np.sqrt(np.mean(np.square(image))))


def trapezoid_mean(frames):
    """Mean over evenly spaced frames, the first and last counted half."""
    weight = np.full(len(frames), 1.0 / (len(frames) - 1))
    weight[[0, -1]] /= 2
    return np.tensordot(weight, np.asarray(frames, np.float64), 1)


def reblur_error(frames, captured):
    """RMS in grey levels of 255 between the mean of the frames and the captured one."""
    return 255 * rms(trapezoid_mean(frames) - captured)


def event_image(t, x, y, p, begin, end, shape):
    """Signed count of the events of begin <= t < end (p: 0 darker, 1 brighter)."""
    chosen = (t >= begin) & (t < end)
    pixel = y[chosen].astype(np.int64) * shape[1] + x[chosen]
    sign = np.where(p[chosen] > 0, 1.0, -1.0)
    return np.bincount(pixel, sign, shape[0] * shape[1]).reshape(shape)


def event_agreement(before, after, signed_count):
    """Correlation over pixels of the change of ln(I + 0.01) with the events' signed count, both smoothed;
    None where one of them does not vary."""
    change = smooth(np.log(after + LOG_EPS) - np.log(before + LOG_EPS))
    count = smooth(signed_count)
    change, count = change - change.mean(), count - count.mean()
    norm = np.sqrt(np.sum(change ** 2) * np.sum(count ** 2))
    return float(np.sum(change * count) / norm) if norm > 1e-9 else None


def gradient(frame):
    """RMS gradient after smoothing."""
    down, right = np.gradient(smooth(frame))
    return float(np.sqrt(np.mean(down ** 2 + right ** 2)))


def ghost_error(last, first):
    """RMS in grey levels of 255 between the last frame of an exposure and the first of the next, after
    the translation between them is undone, as far as it is small enough; a border is left out."""
    last, first = (np.asarray(frame, np.float32) for frame in (last, first))
    window = cv2.createHanningWindow(last.shape[::-1], cv2.CV_32F)
    shift, _ = cv2.phaseCorrelate(last.copy(), first.copy(), window)    # OpenCV 4.6 applies the window in place
    border = max(2, min(16, min(last.shape) // 8))
    best = 255 * rms((first - last)[border:-border, border:-border])
    for start in (shift, (0.0, 0.0)):
        if max(map(abs, start)) > border:
            continue
        warp = np.array([[1, 0, start[0]], [0, 1, start[1]]], np.float32)
        try:
            criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-5)
            _, warp = cv2.findTransformECC(last, first, warp, cv2.MOTION_TRANSLATION, criteria, None, 5)
        except cv2.error:
            pass    # frames without texture: the start is as good
        if np.abs(warp[:, 2]).max() > border:
            continue
        moved = cv2.warpAffine(first, warp, last.shape[::-1], flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP,
                               borderMode=cv2.BORDER_REPLICATE)
        best = min(best, 255 * rms((moved - last)[border:-border, border:-border]))
    return best
