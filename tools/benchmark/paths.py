"""Makes the modules of tools/train importable; the tool's own have other names."""
import os
import sys

ROOT = os.path.abspath(os.path.join(os.path.dirname(__file__), "..", ".."))
TRAIN = os.path.join(ROOT, "tools", "train")
if TRAIN not in sys.path:
    sys.path.append(TRAIN)
