"""Makes the modules of tools/train importable; the tool's own have other names."""
import os
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.abspath(os.path.join(HERE, "..", ".."))
TRAIN = os.path.join(ROOT, "tools", "train")
if TRAIN not in sys.path:
    sys.path.append(TRAIN)
