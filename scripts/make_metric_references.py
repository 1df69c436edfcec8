#!/usr/bin/env python3
"""Makes the image pairs of tests/library/measure/metrics.rs and the values of other programs for them.

    pip install flip-evaluator scikit-image OpenEXR pillow numpy
    scripts/make_metric_references.py            # writes tests/data/metrics/

The pictures come from formulas and a seeded generator. FLIP is the authors' package flip-evaluator,
SSIM is scikit-image; both get the same values that lightpath computes from the files.
"""

import json
from importlib.metadata import version
from pathlib import Path

import flip_evaluator
import numpy as np
import OpenEXR
from PIL import Image
from skimage.metrics import structural_similarity

OUT = Path(__file__).resolve().parent.parent / "tests" / "data" / "metrics"
WIDTH, HEIGHT = 64, 48


def grid():
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float64)
    return x / WIDTH, y / HEIGHT


def scene(shift):
    """Returns a picture of discs, stripes and a gradient, with values in [0, 1]."""
    x, y = grid()
    x = x - shift
    image = np.stack([0.2 + 0.6 * y, 0.5 + 0.0 * x, 0.8 - 0.5 * y], axis=-1)
    stripes = (np.sin(60 * x) > 0) & (y > 0.7)
    image[stripes] = [0.9, 0.85, 0.2]
    for cx, cy, radius, colour in [(0.3, 0.35, 0.2, [0.8, 0.1, 0.1]), (0.7, 0.4, 0.15, [0.1, 0.2, 0.9])]:
        image[(x - cx) ** 2 + (y - cy) ** 2 < radius**2] = colour
    return image


def write_png(name, image):
    Image.fromarray(np.round(255 * np.clip(image, 0, 1)).astype(np.uint8)).save(OUT / f"{name}.png", optimize=True)


def write_exr(name, image):
    # 16-bit floats make small files, and are exact for the test.
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"RGB": image.astype(np.float16)}).write(str(OUT / f"{name}.exr"))


def linear_from_srgb(s):
    return np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4)


def srgb_from_linear(x):
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def read(name):
    """Returns linear values as in lightpath, and the 8-bit picture in [0, 1]."""
    png = OUT / f"{name}.png"
    if png.exists():
        picture = np.asarray(Image.open(png)).astype(np.float64) / 255
        return linear_from_srgb(picture), picture
    linear = OpenEXR.File(str(OUT / f"{name}.exr")).channels()["RGB"].pixels.astype(np.float64)
    return linear, np.round(255 * srgb_from_linear(np.clip(linear, 0, 1))) / 255


def flip(reference, test, kind):
    float32 = lambda image: np.ascontiguousarray(image, dtype=np.float32)
    errors, mean, _ = flip_evaluator.evaluate(
        float32(reference), float32(test), kind, inputsRGB=False, applyMagma=False
    )
    errors = np.asarray(errors, dtype=np.float64).reshape(HEIGHT, WIDTH)
    return {"mean": float(mean), "map": [[float(v) for v in row] for row in errors[::7, ::7]]}


def ssim(reference, test):
    luma = lambda image: image @ np.array([0.2126, 0.7152, 0.0722])
    return float(
        structural_similarity(
            luma(reference), luma(test), data_range=1.0, gaussian_weights=True, sigma=1.5, use_sample_covariance=False
        )
    )


def main():
    OUT.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng(7)
    # Moved edges; noise; bright light with noise and a firefly.
    write_png("edges-test", scene(1.5 / WIDTH))
    write_png("edges-reference", scene(0))
    write_png("noise-test", scene(0) + random.normal(0, 0.08, (HEIGHT, WIDTH, 3)))
    write_png("noise-reference", scene(0))
    x, y = grid()
    light = scene(0) ** 2.2 * (0.05 + 40 * np.exp(-30 * ((x - 0.6) ** 2 + (y - 0.3) ** 2)))[..., None]
    noisy = light * random.gamma(20, 1 / 20, (HEIGHT, WIDTH, 1))
    noisy[20, 11] = [300, 280, 250]
    write_exr("bright-test", noisy)
    write_exr("bright-reference", light)
    pairs = {}
    for name in ["edges", "noise", "bright"]:
        (test, test8), (reference, reference8) = read(f"{name}-test"), read(f"{name}-reference")
        pairs[name] = {
            "ldr_flip": flip(linear_from_srgb(reference8), linear_from_srgb(test8), "LDR"),
            "hdr_flip": flip(reference, test, "HDR"),
            "ssim": ssim(reference8, test8),
        }
    made_with = {name: version(name) for name in ["flip-evaluator", "scikit-image", "numpy"]}
    text = json.dumps({"made_with": made_with, "map_step": 7, "pairs": pairs}, indent=1)
    (OUT / "expected.json").write_text(text + "\n")


if __name__ == "__main__":
    main()
