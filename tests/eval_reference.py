#!/usr/bin/env python3
"""Prints the figures that tests/test_eval.cpp expects, from scikit-image (0.19.3).

The pictures come from the same whole-number formulas as there. Run: python3 tests/eval_reference.py
"""
import numpy as np
from skimage.metrics import peak_signal_noise_ratio, structural_similarity


def pictures(width, height, channels, strength):
    y, x, c = np.mgrid[0:height, 0:width, 0:channels]
    truth = (3 * x + 5 * y + 4 * (x * y % 17) + 60 * c) % 256
    noise = (7 * x + 11 * y + x * y + 5 * c) % 23 - 11
    prediction = np.clip(truth + strength * noise, 0, 255)
    if channels == 1:
        truth, prediction = truth[..., 0], prediction[..., 0]
    return truth.astype(np.uint8), prediction.astype(np.uint8)


for case in [(32, 24, 1, 1), (7, 7, 1, 2), (13, 29, 1, 6), (20, 15, 3, 3)]:
    truth, prediction = pictures(*case)
    error = truth.astype(np.float64) - prediction
    nrmse = np.sqrt(np.mean(error**2)) / np.sqrt(np.mean(truth.astype(np.float64) ** 2))
    psnr = peak_signal_noise_ratio(truth, prediction, data_range=255)
    ssim = structural_similarity(
        truth, prediction, data_range=255, channel_axis=2 if case[2] == 3 else None
    )
    print(f"{{{', '.join(map(str, case))}, {nrmse:.6f}, {psnr:.6f}, {ssim:.6f}}},")
