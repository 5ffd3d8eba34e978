"""Motion from the prior's frames alone, by least squares (Lucas and Kanade, then Gauss-Newton).

Where brightness only moves, dX/dt + v . grad X = 0 for any function X of the brightness. First the
exposure is cut into WINDOWS; in each, the change of X between two frames of the prior and their mean
gradient give one equation a pixel, solved together over a wide neighbourhood and the windows between two
anchors for how far things move there. Noise in the gradients makes that too little in fast scenes; so
frames at neighbouring anchors are then moved half-way towards each other and what remains is solved for
again, in a smaller neighbourhood, ROUNDS times. It is drawn towards 0: where events are few the prior
stands still, and more rounds, or less of that, find less and less motion.
"""
import numpy as np

WINDOWS = 32
TIMES = np.linspace(-1, 1, WINDOWS + 1)
ANCHORS = np.linspace(-1, 1, 9)
GAPS = len(ANCHORS) - 1
CELL = 8            # pixels a side of a cell
EPS = 0.05          # of X = ln(max(L, 0) + EPS); larger than EDI's, so that the dark is less noisy
RIDGE = 2e-6        # added to the mean squared gradients in the first solution
FASTEST = 40.0      # and it is cut there, pixels a gap
ROUNDS = 1
ROUND_RIDGE = 1e-3
ROUND_LIMIT = 2.0   # pixels that a round may add to a displacement from anchor to anchor
BINOMIAL = np.array([1, 4, 6, 4, 1]) / 16


def _smooth(a, kernel, step, mode):
    """Symmetric separable filter over the last two axes."""
    reach = len(kernel) // 2 * step
    for axis in (-1, -2):
        width = [(0, 0)] * a.ndim
        width[axis] = (reach, reach)
        padded, size = np.pad(a, width, mode), a.shape[axis]
        a = sum(weight * np.take(padded, np.arange(i * step, i * step + size), axis) for i, weight in enumerate(kernel))
    return a


def half_size(frames):
    """X at half resolution, smoothed by [1 2 1]: the last row and column count twice where the size
    is odd, pixels outside are the nearest inside."""
    x = np.log(np.maximum(frames, 0) + EPS)
    x = np.pad(x, [(0, 0), (0, x.shape[1] % 2), (0, x.shape[2] % 2)], "edge")
    x = 0.25 * (x[:, ::2, ::2] + x[:, 1::2, ::2] + x[:, ::2, 1::2] + x[:, 1::2, 1::2])
    return _smooth(x, (0.25, 0.5, 0.25), 1, "edge")


def gradient(x):
    """Central differences a full-resolution pixel of a half-resolution picture: x, y."""
    padded = np.pad(x, [(0, 0), (1, 1), (1, 1)], "edge")
    return (0.25 * (padded[:, 1:-1, 2:] - padded[:, 1:-1, :-2]),
            0.25 * (padded[:, 2:, 1:-1] - padded[:, :-2, 1:-1]))


def pool(gx, gy, change):
    """Means over cells of GxGx, GxGy, GyGy, GxD, GyD, [5, N, h, w]; what is outside counts as 0."""
    products = np.stack([gx * gx, gx * gy, gy * gy, gx * change, gy * change])
    side = CELL // 2
    rows, columns = -(-gx.shape[1] // side), -(-gx.shape[2] // side)
    products = np.pad(products, [(0, 0), (0, 0), (0, rows * side - gx.shape[1]), (0, columns * side - gx.shape[2])])
    return products.reshape(5, -1, rows, side, columns, side).mean((3, 5))


def solve(q, ridge):
    """Minimises sum (D + d . G)^2 + ridge |d|^2: displacement d, [N, 2, h, w]."""
    a, b, c = q[0] + ridge, q[1], q[2] + ridge
    determinant = a * c - b * b
    return np.stack([-(c * q[3] - b * q[4]) / determinant, -(a * q[4] - b * q[3]) / determinant], 1)


def first_estimate(frames):
    """Displacements over the gaps between anchors, [8, 2, h, w] in pixels, from the prior at TIMES, [33, H, W]."""
    x = half_size(frames)
    gx, gy = gradient(0.5 * (x[1:] + x[:-1]))
    each = WINDOWS // GAPS
    q = pool(gx, gy, x[1:] - x[:-1])
    q = q.reshape(5, GAPS, each, *q.shape[2:]).mean(2)
    q = _smooth(_smooth(q, BINOMIAL, 1, "constant"), BINOMIAL, 2, "constant")
    return np.clip(each * solve(q, RIDGE), -FASTEST, FASTEST)


def bilinear(picture, x, y):
    """Values of picture [H, W] at x, y (0 at the first pixel's centre), beyond the border its value."""
    x, y = np.clip(x, 0, picture.shape[1] - 1), np.clip(y, 0, picture.shape[0] - 1)
    x0, y0 = np.minimum(x.astype(int), picture.shape[1] - 2), np.minimum(y.astype(int), picture.shape[0] - 2)
    fx, fy = x - x0, y - y0
    top = picture[y0, x0] * (1 - fx) + picture[y0, x0 + 1] * fx
    return top * (1 - fy) + (picture[y0 + 1, x0] * (1 - fx) + picture[y0 + 1, x0 + 1] * fx) * fy


def refine(anchors, found):
    """The displacements after ROUNDS of Gauss-Newton; anchors: the prior at ANCHORS, [9, H, W].

    A displacement is that of what is half-way: X of the earlier anchor is fetched at p - d / 2 and of the
    later one at p + d / 2, their difference and mean gradient give the equations. Pixels whose fetches lie
    outside the picture do not count.
    """
    x = half_size(anchors)
    gx, gy = gradient(x)
    rows, columns = x.shape[1:]
    py, px = np.indices((rows, columns), float)     # half-resolution pixels
    cell_y, cell_x = (py + 0.5) / (CELL // 2) - 0.5, (px + 0.5) / (CELL // 2) - 0.5
    found = found.copy()
    for _ in range(ROUNDS):
        for i in range(len(found)):
            half = [0.25 * bilinear(part, cell_x, cell_y) for part in found[i]]     # d / 2 in these pixels
            early, late = (px - half[0], py - half[1]), (px + half[0], py + half[1])
            inside = [(u >= -0.5) & (u <= columns - 0.5) & (v >= -0.5) & (v <= rows - 0.5) for u, v in (early, late)]
            valid = inside[0] & inside[1]
            change = bilinear(x[i + 1], *late) - bilinear(x[i], *early)
            mean = [valid * 0.5 * (bilinear(g[i], *early) + bilinear(g[i + 1], *late)) for g in (gx, gy)]
            q = _smooth(pool(mean[0][None], mean[1][None], change[None]), BINOMIAL, 1, "constant")
            found[i] += np.clip(solve(q, ROUND_RIDGE)[0], -ROUND_LIMIT, ROUND_LIMIT)
    return found


def estimate(frames):
    """Displacements (x, y) of what is at cells' centres half-way between neighbouring ANCHORS, pixels,
    [8, 2, ceil(H / 8), ceil(W / 8)], from the prior's frames at TIMES, [33, H, W]."""
    return refine(frames[::WINDOWS // GAPS], first_estimate(frames))
