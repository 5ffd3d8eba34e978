"""PSNR, SSIM and normalised RMSE of 8-bit frames, as in E-CIR's published evaluation."""
import numpy as np
from skimage.metrics import structural_similarity


def to_codes(frame):
    """8-bit codes of [0, 1] frames: clipped, times 255, truncated."""
    return (np.clip(frame, 0, 1) * 255).astype(np.uint8)


def psnr(prediction, truth):
    """dB of one 8-bit frame; inf for identical frames."""
    mse = np.mean((prediction.astype(np.float64) - truth) ** 2)
    return 10 * np.log10(255 ** 2 / mse) if mse > 0 else np.inf


def measure(prediction, truth):
    """PSNR (dB), SSIM and NRMSE of one 8-bit frame; PSNR is inf for identical frames."""
    a, b = prediction.astype(np.float64), truth.astype(np.float64)
    nrmse = np.sqrt(np.mean((a - b) ** 2) / np.mean(b ** 2))
    return psnr(prediction, truth), structural_similarity(prediction, truth, data_range=255), nrmse
