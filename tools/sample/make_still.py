#!/usr/bin/env python3
"""Paints the sample's still: a shop front with a bicycle, grey, 640x480.

Everything is drawn here, so the picture is the project's own. Run: python3 make_still.py still.png
(needs numpy and OpenCV).
"""
import sys

import cv2
import numpy as np

WIDTH, HEIGHT = 640, 480
FINE = 4  # drawn this much larger, then averaged down, which smooths every edge
rng = np.random.default_rng(2022)


def fine(*values):
    """Picture coordinates to whole pixels of the fine canvas."""
    return tuple(int(round(v * FINE)) for v in values)


def noise(cell, octaves=4):
    """Smooth noise in about [-1, 1]; `cell` is its coarsest grain in pixels."""
    total = np.zeros((HEIGHT * FINE, WIDTH * FINE), np.float32)
    for octave in range(octaves):
        step = cell / 2**octave
        rows, columns = int(HEIGHT / step) + 3, int(WIDTH / step) + 3
        grid = rng.standard_normal((rows, columns)).astype(np.float32)
        layer = cv2.resize(grid, total.shape[::-1], interpolation=cv2.INTER_CUBIC)
        total += layer * 0.5 ** (octave + 1)
    return total


def blank():
    return np.zeros((HEIGHT * FINE, WIDTH * FINE), np.float32)


def soft(mask, radius):
    return cv2.GaussianBlur(mask, (0, 0), radius * FINE)


def rectangle(canvas, x0, y0, x1, y1, tone):
    cv2.rectangle(canvas, fine(x0, y0), tuple(v - 1 for v in fine(x1, y1)), tone, -1)


def polygon(canvas, points, tone):
    cv2.fillPoly(canvas, [np.array([fine(*p) for p in points], np.int32)], tone, cv2.LINE_AA)


def line(canvas, a, b, width, tone):
    cv2.line(canvas, fine(*a), fine(*b), tone, max(1, round(width * FINE)), cv2.LINE_AA)


def ellipse(canvas, centre, axes, tone, width=-1.0, start=0, end=360, angle=0):
    thickness = -1 if width < 0 else max(1, round(width * FINE))
    cv2.ellipse(
        canvas, fine(*centre), fine(*axes), angle, start, end, tone, thickness, cv2.LINE_AA
    )


def letters(canvas, x, y, size, width, tone):
    """The word ecir in round strokes; (x, y) is the left end of the base line."""
    r = size / 2
    middle = y - r
    ellipse(canvas, (x + r, middle), (r, r), tone, width, 40, 360)
    line(canvas, (x, middle), (x + 2 * r, middle), width, tone)
    x += 2 * r + size * 0.42
    ellipse(canvas, (x + r, middle), (r, r), tone, width, 48, 312)
    x += 2 * r + size * 0.30
    line(canvas, (x, y), (x, y - 2 * r), width, tone)
    ellipse(canvas, (x, y - 2.75 * r), (width * 0.72, width * 0.72), tone)
    x += size * 0.48
    line(canvas, (x, y), (x, y - 2 * r), width, tone)
    ellipse(canvas, (x + r * 0.95, y - r * 1.02), (r * 0.95, r * 0.98), tone, width, 180, 305)


def bricks(canvas):
    canvas[:] = 0.60
    height, width, mortar = 12.0, 33.0, 1.6
    for row in range(int(HEIGHT / height) + 1):
        x = -width * (0.5 if row % 2 else 1.0) + rng.normal(0, 0.4)
        while x < WIDTH:
            tone = float(np.clip(rng.normal(0.44, 0.055), 0.28, 0.62))
            if rng.random() < 0.06:
                tone *= 0.68
            y0 = row * height + rng.normal(0, 0.2)
            y1, x1 = y0 + height - mortar, x + width - mortar
            rectangle(canvas, x, y0, x1, y1, tone)
            line(canvas, (x, y0), (x1, y0), 0.7, tone * 1.25)
            line(canvas, (x, y1), (x1, y1), 0.8, tone * 0.62)
            line(canvas, (x1, y0), (x1, y1), 0.6, tone * 0.72)
            x += width
    canvas *= 1 + 0.06 * noise(3.0, 3) + 0.10 * noise(90.0, 3)


def pavement(canvas, top):
    rectangle(canvas, 0, top, WIDTH, HEIGHT, 0.5)
    edges = [top, top + 13, top + 34, top + 64, HEIGHT + 20]
    vanishing = (330, top - 330)
    for row, (y0, y1) in enumerate(zip(edges, edges[1:])):
        step = 64 if row else 92
        for k in range(-9, 10):
            offset = (k + (0.5 if row % 2 else 0.0)) * step
            corners = []
            for y, shift in ((y0, 0), (y0, step), (y1, step), (y1, 0)):
                scale = (y - vanishing[1]) / (top + 34 - vanishing[1])
                corners.append((vanishing[0] + (offset + shift) * scale, y))
            polygon(canvas, corners, float(np.clip(rng.normal(0.64, 0.045), 0.5, 0.78)))
            line(canvas, corners[0], corners[3], 1.2, 0.30)
        line(canvas, (0, y0), (WIDTH, y0), 1.4, 0.28)
    grain = 1 + 0.05 * noise(2.4, 2) + 0.12 * noise(60.0, 4)
    part = slice(top * FINE, None)
    canvas[part] *= grain[part]
    shade = np.linspace(0.72, 1.08, canvas[part].shape[0], dtype=np.float32)
    canvas[part] *= shade[:, None]


def shelf_goods(canvas, x0, x1, base):
    """Books, jars and cups side by side on a shelf."""
    x = x0 + 3
    while x < x1 - 12:
        kind = rng.choice(3, p=[0.55, 0.28, 0.17])
        if kind == 0:
            for _ in range(int(rng.integers(3, 8))):
                width, height = rng.uniform(3.2, 6.5), rng.uniform(21, 33)
                if x + width > x1 - 2:
                    break
                tone = float(rng.uniform(0.16, 0.82))
                rectangle(canvas, x, base - height, x + width, base, tone)
                line(canvas, (x, base - height), (x, base), 0.6, tone * 0.5)
                band = base - height * float(rng.uniform(0.55, 0.8))
                rectangle(canvas, x + 0.6, band, x + width - 0.6, band + 2.2, 1.0 - tone)
                x += width + 0.5
            x += 4
        elif kind == 1:
            width, height = rng.uniform(12, 16), rng.uniform(17, 25)
            tone = float(rng.uniform(0.45, 0.75))
            rectangle(canvas, x, base - height, x + width, base, tone)
            rectangle(canvas, x + 1, base - height - 4, x + width - 1, base - height, 0.22)
            rectangle(canvas, x + 1.5, base - height * 0.7, x + width - 1.5, base - 4, 0.88)
            line(canvas, (x + 3, base - 9), (x + width - 3, base - 9), 0.9, 0.3)
            line(canvas, (x + 3, base - 12), (x + width - 4, base - 12), 0.9, 0.3)
            line(canvas, (x + 1.6, base - height), (x + 1.6, base), 1.0, 0.95)
            x += width + 4
        else:
            ellipse(canvas, (x + 14, base - 6), (4, 4), 0.8, 1.5)
            corners = [(x, base - 13), (x + 13, base - 13), (x + 11, base), (x + 2, base)]
            polygon(canvas, corners, 0.84)
            ellipse(canvas, (x + 6.5, base - 13), (6.5, 1.8), 0.5)
            x += 23


def window(canvas):
    x0, y0, x1, y1 = 42, 128, 302, 338
    rectangle(canvas, x0 - 9, y0 - 9, x1 + 9, y1 + 9, 0.20)
    rectangle(canvas, x0, y0, x1, y1, 0.13)
    columns = [(x0, 124), (131, 213), (220, x1)]
    for left, right in columns:
        for shelf in (186, 240, 292, y1):
            shelf_goods(canvas, left, right, shelf - 3)
            rectangle(canvas, left, shelf - 3, right, shelf, 0.46)
            rectangle(canvas, left, shelf, right, shelf + 2, 0.05)
    inside = (slice(y0 * FINE, y1 * FINE), slice(x0 * FINE, x1 * FINE))
    # The sky's reflection: brighter to the upper right, in slanted bands.
    rows, cols = np.mgrid[0:1:210j, 0:1:260j].astype(np.float32)
    bands = 0.5 + 0.5 * np.tanh(9 * (np.sin(5.2 * (cols - 0.62 * rows) + 0.4) - 0.72))
    sheen = cv2.resize(0.05 + 0.20 * bands * (1.1 - rows), canvas[inside].shape[::-1])
    canvas[inside] = canvas[inside] * (1 - 0.8 * sheen) + sheen
    for x in (124, 213):
        rectangle(canvas, x, y0, x + 7, y1, 0.25)
        line(canvas, (x + 0.6, y0), (x + 0.6, y1), 1.0, 0.48)
    line(canvas, (x0 - 8, y0 - 8), (x0 - 8, y1 + 8), 1.2, 0.42)
    rectangle(canvas, x0 - 15, y1 + 8, x1 + 15, y1 + 17, 0.74)
    rectangle(canvas, x0 - 15, y1 + 17, x1 + 15, y1 + 20, 0.22)


def sign(canvas):
    rectangle(canvas, 28, 22, 316, 82, 0.70)
    rectangle(canvas, 31, 25, 313, 79, 0.12)
    board = (slice(25 * FINE, 79 * FINE), slice(31 * FINE, 313 * FINE))
    canvas[board] += 0.025 * cv2.resize(
        rng.standard_normal((54, 12)).astype(np.float32), canvas[board].shape[::-1]
    )
    cv2.rectangle(canvas, fine(36, 30), fine(308, 74), 0.55, FINE)
    letters(canvas, 114.5, 68.5, 25, 5.4, 0.02)
    letters(canvas, 113, 67, 25, 5.4, 0.93)
    for x in (66, 276):
        ellipse(canvas, (x, 52), (11, 11), 0.80, 1.6)
        for k in range(12):
            a = np.pi * k / 6
            tip = (x + 9 * np.cos(a), 52 + 9 * np.sin(a))
            line(canvas, (x, 52), tip, 0.9, 0.80)


def awning(canvas):
    stripes, left, right, top, bottom = 15, 28.0, 316.0, 88.0, 130.0
    for k in range(stripes):
        u0, u1 = k / stripes, (k + 1) / stripes
        a, b = left + u0 * (right - left), left + u1 * (right - left)
        c, d = left - 10 + u0 * (right - left + 20), left - 10 + u1 * (right - left + 20)
        tone = 0.86 if k % 2 == 0 else 0.30
        polygon(canvas, [(a, top), (b, top), (d, bottom), (c, bottom)], tone)
        polygon(canvas, [(c, bottom), (d, bottom), (d, bottom + 7), (c, bottom + 7)], tone * 0.8)
        ellipse(canvas, ((c + d) / 2, bottom + 7), ((d - c) / 2, 5.5), tone * 0.8, -1, 0, 180)
        line(canvas, (b, top), (d, bottom), 0.6, 0.2)
    line(canvas, (left - 10, bottom), (right + 10, bottom), 0.8, 0.25)
    rows = slice(int(top * FINE), int(bottom * FINE))
    cols = slice(int((left - 10) * FINE), int((right + 10) * FINE))
    shade = np.linspace(1.08, 0.80, rows.stop - rows.start, dtype=np.float32)[:, None]
    canvas[rows, cols] = np.minimum(canvas[rows, cols] * shade, 1)


def door(canvas):
    x0, y0, x1, y1 = 372, 118, 470, 377
    rectangle(canvas, x0 - 10, y0 - 12, x1 + 10, y1, 0.78)
    line(canvas, (x0 - 10, y0 - 12), (x1 + 10, y0 - 12), 2, 0.92)
    rectangle(canvas, x0 - 2, y0 - 2, x1 + 2, y1, 0.16)
    rectangle(canvas, x0, y0, x1, y1, 0.34)
    for left, right in ((382, 417), (425, 460)):
        rectangle(canvas, left, 132, right, 242, 0.10)
        for row in range(3):
            top = 134 + row * 36.5
            for shift, tone in ((0, 0.30), (9, 0.44), (18, 0.26)):
                polygon(
                    canvas,
                    [
                        (left + 2, top + shift + 14),
                        (right - 2, top + shift - 2),
                        (right - 2, top + 34),
                        (left + 2, top + 34),
                    ],
                    tone,
                )
            rectangle(canvas, left, top + 34, right, top + 37, 0.36)
        for top, bottom in ((258, 300), (312, 364)):
            rectangle(canvas, left, top, right, bottom, 0.24)
            rectangle(canvas, left + 3, top + 3, right, bottom, 0.46)
            rectangle(canvas, left + 3, top + 3, right - 3, bottom - 3, 0.36)
    line(canvas, (421, y0), (421, y1), 1.2, 0.14)
    rectangle(canvas, 428, 246, 432, 262, 0.62)
    ellipse(canvas, (430, 254), (4.5, 4.5), 0.95)
    rectangle(canvas, x0 - 16, y1 - 8, x1 + 16, y1 + 4, 0.66)
    line(canvas, (x0 - 16, y1 - 8), (x1 + 16, y1 - 8), 1.2, 0.9)
    rectangle(canvas, 408, 92, 434, 103, 0.12)
    cv2.putText(
        canvas, "2022", fine(410.5, 100.5), cv2.FONT_HERSHEY_SIMPLEX, 0.30 * FINE, 0.9, FINE,
        cv2.LINE_AA,
    )


def lantern(canvas, x, y):
    line(canvas, (x - 14, y - 6), (x, y - 18), 2.0, 0.08)
    line(canvas, (x - 14, y - 18), (x, y - 18), 2.0, 0.08)
    polygon(canvas, [(x - 9, y - 6), (x + 9, y - 6), (x, y - 17)], 0.09)
    polygon(canvas, [(x - 8, y - 6), (x + 8, y - 6), (x + 5, y + 18), (x - 5, y + 18)], 0.96)
    for a, b in ((-8, -5), (8, 5), (0, 0)):
        line(canvas, (x + a, y - 6), (x + b, y + 18), 1.3, 0.10)
    rectangle(canvas, x - 6, y + 18, x + 6, y + 21, 0.09)


def shrub(canvas, x, base, radius):
    polygon(canvas, [(x - 17, base - 34), (x + 17, base - 34), (x + 12, base), (x - 12, base)], 0.62)
    polygon(canvas, [(x + 4, base - 34), (x + 17, base - 34), (x + 12, base), (x + 3, base)], 0.46)
    rectangle(canvas, x - 19, base - 38, x + 19, base - 31, 0.70)
    centre = (x, base - 38 - radius * 0.78)
    ellipse(canvas, centre, (radius * 0.86, radius * 0.86), 0.10)
    for _ in range(620):
        a, r = rng.uniform(0, 2 * np.pi), radius * np.sqrt(rng.uniform(0, 1))
        u, v = r * np.cos(a), r * np.sin(a)
        light = 0.30 - 0.20 * (0.5 * u + 0.8 * v) / radius + rng.normal(0, 0.07)
        ellipse(
            canvas, (centre[0] + u, centre[1] + v), (3.1, 1.4), float(np.clip(light, 0.06, 0.68)),
            angle=rng.uniform(0, 180),
        )


def board(canvas):
    """A folding chalk board on the pavement."""
    polygon(canvas, [(530, 296), (602, 296), (612, 412), (520, 412)], 0.58)
    polygon(canvas, [(536, 302), (596, 302), (603, 400), (529, 400)], 0.11)
    for x0, x1 in ((520, 526), (606, 612)):
        polygon(canvas, [(x0, 408), (x1, 408), (x1, 422), (x0, 422)], 0.44)
    font = cv2.FONT_HERSHEY_SCRIPT_COMPLEX
    for text, x, y, size in (("blur", 547, 328, 0.62), ("+ events", 534, 352, 0.50)):
        cv2.putText(canvas, text, fine(x, y), font, size * FINE, 0.9, 5, cv2.LINE_AA)
    line(canvas, (540, 361), (592, 361), 1.2, 0.85)
    cv2.putText(canvas, "film", fine(549, 388), font, 0.70 * FINE, 0.95, 6, cv2.LINE_AA)


def wheel(canvas, x, y, r):
    for k in range(28):
        a = 2 * np.pi * k / 28
        b = a + (0.42 if k % 2 else -0.42)
        hub = (x + 3 * np.cos(b), y + 3 * np.sin(b))
        line(canvas, hub, (x + r * np.cos(a), y + r * np.sin(a)), 0.55, 0.80)
    ellipse(canvas, (x, y), (r, r), 0.07, 4.0)
    ellipse(canvas, (x, y), (r - 2.6, r - 2.6), 0.82, 1.3)
    ellipse(canvas, (x, y), (4, 4), 0.70)
    ellipse(canvas, (x, y), (2, 2), 0.15)


def bicycle(canvas):
    r, ground = 46, 424
    rear, front = (102, ground - r), (240, ground - r)
    crank, saddle, head, fork = (164, ground - 38), (142, 322), (214, 314), (218, 330)
    wheel(canvas, *rear, r)
    wheel(canvas, *front, r)
    for a, b in (
        (rear, crank), (rear, (146, 334)), (crank, saddle), ((148, 338), head), (crank, fork),
        (fork, front), (head, fork),
    ):
        line(canvas, a, b, 4.6, 0.16)
        line(canvas, (a[0] - 0.6, a[1] - 1.1), (b[0] - 0.6, b[1] - 1.1), 1.3, 0.92)
    for start, end in ((180, 290), (195, 320)):
        at = rear if start == 180 else front
        ellipse(canvas, at, (r + 4, r + 4), 0.30, 2.4, start, end)
    line(canvas, saddle, (139, 310), 3.0, 0.75)
    polygon(canvas, [(122, 304), (150, 303), (160, 308), (148, 312), (130, 314)], 0.08)
    line(canvas, (125, 305), (149, 304), 1.0, 0.5)
    line(canvas, head, (209, 298), 3.0, 0.78)
    line(canvas, (209, 298), (226, 290), 2.6, 0.80)
    line(canvas, (226, 290), (206, 286), 2.6, 0.80)
    line(canvas, (214, 287), (203, 285), 4.2, 0.10)
    ellipse(canvas, crank, (11, 11), 0.72, 1.8)
    ellipse(canvas, crank, (4, 4), 0.20)
    for tip in ((174, ground - 22), (154, ground - 54)):
        line(canvas, crank, tip, 2.4, 0.70)
        line(canvas, (tip[0] - 6, tip[1]), (tip[0] + 6, tip[1]), 3.0, 0.10)
    line(canvas, (rear[0], rear[1] - 5), (crank[0], crank[1] - 10), 0.9, 0.12)
    line(canvas, (rear[0], rear[1] + 5), (crank[0], crank[1] + 10), 0.9, 0.12)
    # A wicker basket with flowers.
    polygon(canvas, [(222, 304), (262, 304), (257, 334), (227, 334)], 0.66)
    for k in range(6):
        line(canvas, (223 + k * 0.6, 308 + 5 * k), (261 - k * 0.6, 308 + 5 * k), 1.0, 0.38)
        x = 226 + 6.4 * k
        line(canvas, (x, 304), (x + (242 - x) * 0.12, 334), 1.0, 0.44)
    for _ in range(46):
        at = (rng.uniform(222, 262), rng.uniform(288, 304))
        ellipse(canvas, at, (4.2, 1.6), float(rng.uniform(0.12, 0.34)), angle=rng.uniform(0, 180))
    for _ in range(15):
        x, y = rng.uniform(224, 260), rng.uniform(286, 300)
        for k in range(5):
            a = 2 * np.pi * k / 5
            ellipse(canvas, (x + 2 * np.cos(a), y + 2 * np.sin(a)), (1.6, 1.6), 0.96)
        ellipse(canvas, (x, y), (1.2, 1.2), 0.35)


def stand(scene, draw, shift, radius, strength):
    """Draws something in front of the scene, with its shadow thrown on what lies behind."""
    marked = np.full_like(scene, -1)
    draw(marked)
    mask = (marked >= 0).astype(np.float32)
    moved = cv2.warpAffine(
        mask, np.float32([[1, 0, shift[0] * FINE], [0, 1, shift[1] * FINE]]), mask.shape[::-1]
    )
    scene *= 1 - strength * soft(moved, radius)
    np.copyto(scene, marked, where=marked >= 0)


def light(scene):
    """Late sun through a tree: falls off to the right and flickers between leaves."""
    leaves = soft(np.tanh(2.5 * noise(46.0, 4) + 0.5), 1.2)
    rows, cols = np.mgrid[0:1:120j, 0:1:160j].astype(np.float32)
    slope = cv2.resize(1.42 - 0.34 * cols + 0.06 * rows, scene.shape[::-1])
    scene *= slope * (0.95 + 0.13 * leaves)


def main():
    if len(sys.argv) != 2:
        sys.exit("usage: make_still.py OUT.png")
    scene = blank()
    bricks(scene)
    window(scene)
    door(scene)
    pavement(scene, 377)
    for draw, shift, radius, strength in (
        (sign, (3, 4), 2, 0.55),
        (awning, (7, 20), 4, 0.62),
        (lambda c: lantern(c, 344, 176), (5, 5), 2, 0.5),
        (lambda c: shrub(c, 352, 398, 27), (8, 3), 4, 0.5),
        (lambda c: shrub(c, 496, 400, 30), (8, 3), 4, 0.5),
        (board, (10, 2), 4, 0.5),
        (bicycle, (9, 3), 2.5, 0.45),
    ):
        stand(scene, draw, shift, radius, strength)
    light(scene)
    small = cv2.resize(scene, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), 0.6)
    rows, cols = np.mgrid[-1:1:480j, -1:1:640j]
    small *= 1 - 0.14 * (rows**2 + cols**2) ** 1.2
    small = np.clip(small, 0, None)
    small = 0.02 + 0.97 * small / (1 + np.maximum(small - 0.8, 0))  # highlights roll off
    small += rng.normal(0, 0.003, small.shape)
    cv2.imwrite(sys.argv[1], np.clip(small * 255 + 0.5, 0, 255).astype(np.uint8))


main()
