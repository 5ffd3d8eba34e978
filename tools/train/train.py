#!/usr/bin/env python3
"""Trains a network on packed scenes (pack.py) for a given time, resumably; --help lists the options."""
import argparse
import os

import torch

import task_ecir
import task_fusion
from training import Trainer

TASKS = {"ecir": task_ecir, "fusion": task_fusion}


def parse():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("network", choices=sorted(TASKS))
    parser.add_argument("--cache", required=True, help="training scenes of pack.py")
    parser.add_argument("--validation", required=True, help="validation scenes of pack.py")
    parser.add_argument("--even", help="fusion: scenes of pack.py --even, whose frames' mean must be the blurry frame")
    parser.add_argument("--run", required=True, help="folder for checkpoint.pt, log.csv, model.safetensors")
    parser.add_argument("--minutes", type=float, default=60, help="whole training time, resumed runs included")
    parser.add_argument("--steps", type=int, help="end after so many steps, and let the schedule follow them")
    parser.add_argument("--size", choices=sorted(task_fusion.SIZES), default="base", help="of the fusion network")
    parser.add_argument("--width", type=int, default=32, help="of the E-CIR network")
    parser.add_argument("--inputs", choices=("both", "events", "frame"), default="both",
                        help="what E-CIR's U-Net sees (ablation)")
    parser.add_argument("--output", choices=("curve", "frames"), default="curve",
                        help="what E-CIR's U-Net gives: the derivatives of the curve, or 14 frames (ablation)")
    parser.add_argument("--no-refinement", dest="refined", action="store_false", help="train E-CIR's U-Net alone")
    parser.add_argument("--paper", action="store_true",
                        help="E-CIR with the paper's loss weights and schedule (1e-4, halved after 40 and 80 %%)")
    parser.add_argument("--batch", type=int, default=4)
    parser.add_argument("--rate", type=float, default=1e-3, help="peak learning rate of Adam")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--bfloat16", action="store_true",
                        help="convolutions in bfloat16: several times as fast on a CPU with AMX")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu",
                        help="where to train; checkpoints go on from one to the other")
    parser.add_argument("--start", help="checkpoint of another run, whose weights of equal name and shape to begin with")
    parser.add_argument("--resume", action="store_true", help="go on from the folder's checkpoint.pt")
    args = parser.parse_args()
    if args.minutes <= 0 or args.batch < 2 or args.rate <= 0:
        parser.error("--minutes and --rate must be positive, --batch at least 2")
    if args.paper and args.network != "ecir":
        parser.error("--paper is the schedule of the E-CIR network's paper; the fusion network has one of its own")
    return args


def main():
    args = parse()
    torch.manual_seed(args.seed)
    torch.set_num_threads(int(os.environ.get("OMP_NUM_THREADS", torch.get_num_threads())))
    Trainer(TASKS[args.network], args).run()


if __name__ == "__main__":
    main()
