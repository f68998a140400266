#!/usr/bin/env python3
"""Trains the detector on scans of the simulator; can be stopped at any time and goes on.

    train.py --data DATA --run RUN --steps 6000
    train.py --data DATA --run RUN --steps 2000 --rate 5e-4 --start default.safetensors

The second begins from weights that were shipped (starting.py). RUN holds
`checkpoint.pt` (some 8 bytes a parameter, written every few minutes) and `log.jsonl`; export.py
makes of it what the program reads. The same command again goes on from the checkpoint, on a GPU or
a CPU, wherever it was begun.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # its threads wait by spinning,
os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # and so would these: ten times the time on a busy machine

import argparse
import json
import math
import pathlib
import signal
import time

import network
import losses
import numpy as np
import scans as scan_files
import starting
import torch
import validate

CONFIG = {
    "name": "lite",
    "range_m": [-51.2, -51.2, 0.15, 51.2, 51.2, 4.15],
    "voxel_m": [0.1, 0.1, 0.2],
    "z": "ground",
    "sensor_height_m": 0.0,
    "features": ["dx", "dy", "dz", "height", "ux", "uy"],
    "stages": [{"channels": c, "blocks": 1, "kernel": 3} for c in (16, 32, 48, 64, 64, 64)],
    "pruning": [0.5, 0.5, 0.5, 0.0, 0.0],
    "neck_channels": 64,
    "head_kernel": 1,
    "heads": [{"classes": ["car", "van"]}, {"classes": ["truck", "bus"]},
              {"classes": ["cyclist", "pedestrian"]}],
    "yaw": "axis",
    "branches": ["hm", "center", "center_z", "dim", "rot", "iou"],
    "iou_rectifier": [0.0] * 6,
    "calibration": [[1.0, 0.0]] * 6,
    "nms": "fitted",
    "nms_iou": 0.2,
    "score_threshold": 0.2,
}
# How often objects are pasted from other scans, by class.
PASTED = {"car": 0.5, "van": 1.0, "truck": 1.5, "trailer": 1.0, "bus": 1.5, "motorcycle": 2.0,
          "cyclist": 2.0, "pedestrian": 1.0}


# Batches that layers of a file are measured on, when a run begins from one.
MEASURED = 12


class Samples(torch.utils.data.Dataset):
    """Sample number i is the same in every run with the same seed."""

    def __init__(self, data, config, seed, first, count):
        self.scans, self.config, self.seed = data, config, seed
        self.first, self.count = first, count

    def __len__(self):
        return self.count

    def __getitem__(self, index):
        number = self.first + index
        epoch, position = divmod(number, len(self.scans))
        order = np.random.default_rng([self.seed, epoch]).permutation(len(self.scans))
        rng = np.random.default_rng([self.seed, 1, number])
        file, i = self.scans[order[position]]
        scan = file[i]
        if rng.random() < 0.6:  # another scan of the same drive, that is of the same sensor
            scan_files.paste(scan, file[int(rng.integers(len(file)))], rng, PASTED)
        scan_files.augment(scan, rng)
        features, sites = scan_files.voxels(scan.points, self.config)
        names = [scan_files.LEARNED.get(scan_files.OBJECT_CLASSES[c], "") for c in scan.classes]
        boxes, counts = scan.boxes, scan.counts()
        return (torch.tensor(features), torch.tensor(sites), torch.tensor(boxes), names,
                torch.tensor(counts))


def collate(items):
    sites = [torch.cat([torch.full((len(s), 1), i), s], 1) for i, (_, s, *_) in enumerate(items)]
    scans = [(boxes, names, counts) for _, _, boxes, names, counts in items]
    return torch.cat([f for f, *_ in items]), torch.cat(sites), scans


def rate(step, steps, peak):
    """One cycle: up over the first tenth, down to nothing by half a cosine."""
    up = 0.1 * steps
    if step < up:
        return peak * (0.1 + 0.9 * step / up)
    return peak * max(1e-3, 0.5 * (1 + math.cos(math.pi * (step - up) / (steps - up))))


def save(path, net, optimizer, step, arguments):
    """Moments at half precision: they are averages, and the file stays small."""
    moments = []
    for parameter in net.parameters():
        state = optimizer.state[parameter]
        moments.append((state["exp_avg"].cpu().bfloat16(), state["exp_avg_sq"].cpu().bfloat16()))
    content = {"net": {k: v.cpu() for k, v in net.state_dict().items()}, "moments": moments,
               "step": step, "config": net.config, "steps": arguments.steps,
               "seed": arguments.seed}
    unfinished = path.with_suffix(".part")
    torch.save(content, unfinished)
    unfinished.replace(path)


def restore(path, net, optimizer):
    content = torch.load(path, map_location="cpu")
    net.load_state_dict(content["net"])
    for parameter, (first, second) in zip(net.parameters(), content["moments"]):
        optimizer.state[parameter] = {
            "step": torch.tensor(float(content["step"])),
            "exp_avg": first.float().to(parameter.device),
            "exp_avg_sq": second.float().to(parameter.device)}
    return content["step"]


def begun(arguments, data):
    """The network as a run begins. To measure the file's layers it takes samples that the run does not come to."""
    if not arguments.start:
        return network.VoxelNext(CONFIG)
    samples = Samples(data, CONFIG, arguments.seed + 1, 0, MEASURED * arguments.batch)
    loader = torch.utils.data.DataLoader(samples, arguments.batch, collate_fn=collate)
    return starting.network_of(arguments.start, CONFIG, list(loader))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--data", type=pathlib.Path, required=True)
    parser.add_argument("--run", type=pathlib.Path, required=True)
    parser.add_argument("--start", type=pathlib.Path, help="weights file to begin from")
    parser.add_argument("--steps", type=int, default=6000)
    parser.add_argument("--batch", type=int, default=4)
    parser.add_argument("--rate", type=float, default=2e-3)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=1e9, help="stop after, with a checkpoint")
    parser.add_argument("--validate-every", type=int, default=500)
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    torch.manual_seed(arguments.seed)
    device = "cuda" if torch.cuda.is_available() else "cpu"
    arguments.run.mkdir(parents=True, exist_ok=True)
    checkpoint = arguments.run / "checkpoint.pt"
    data = scan_files.open_scans(arguments.data, "train")
    net = (network.VoxelNext(CONFIG) if checkpoint.exists() else begun(arguments, data)).to(device)
    decayed = [p for n, p in net.named_parameters() if n.endswith("weight") and "norm" not in n]
    others = [p for n, p in net.named_parameters() if not (n.endswith("weight") and "norm" not in n)]
    optimizer = torch.optim.AdamW([{"params": decayed, "weight_decay": 0.01},
                                   {"params": others, "weight_decay": 0.0}],
                                  betas=(0.9, 0.99))
    step = 0
    if checkpoint.exists():
        step = restore(checkpoint, net, optimizer)
    held_out = scan_files.open_scans(arguments.data, "validation")[::6]
    samples = Samples(data, CONFIG, arguments.seed, step * arguments.batch,
                      (arguments.steps - step) * arguments.batch)
    loader = torch.utils.data.DataLoader(samples, arguments.batch, num_workers=1,
                                         collate_fn=collate, prefetch_factor=4)
    stopped = []
    signal.signal(signal.SIGTERM, lambda *_: stopped.append(True))
    log = open(arguments.run / "log.jsonl", "a", encoding="utf-8")

    def note(**values):
        print(json.dumps(values), file=log, flush=True)
        print(json.dumps(values), flush=True)

    note(parameters=sum(p.numel() for p in net.parameters()), scans=len(data), step=step,
         device=device)
    start = saved = time.monotonic()
    first, sums, number = step, {}, 0
    for features, sites, scans in loader:
        for group in optimizer.param_groups:
            group["lr"] = rate(step, arguments.steps, arguments.rate)
        results, places = net(features.to(device), sites.to(device))
        scans = [(b.to(device), names, counts) for b, names, counts in scans]
        loss, parts = losses.loss_of(results, places, scans, CONFIG)
        optimizer.zero_grad()
        loss.backward()
        norm = torch.nn.utils.clip_grad_norm_(net.parameters(), 10.0)
        if torch.isfinite(norm):
            optimizer.step()
        step += 1
        number += 1
        for name, value in {**parts, "norm": float(norm)}.items():
            sums[name] = sums.get(name, 0.0) + value
        now = time.monotonic()
        if step % 50 == 0:
            each = (now - start) / (step - first)
            note(step=step, seconds_a_step=round(each, 3),
                 minutes_left=round(each * (arguments.steps - step) / 60, 1),
                 **{name: round(value / number, 4) for name, value in sums.items()})
            sums, number = {}, 0
        done = stopped or step == arguments.steps or now - start > arguments.minutes * 60
        if done or now - saved > 180:
            save(checkpoint, net, optimizer, step, arguments)
            saved = now
        if step % arguments.validate_every == 0 or step == arguments.steps:
            note(step=step, **validate.evaluate(net, [f[i] for f, i in held_out], CONFIG))
        if done:
            break


if __name__ == "__main__":
    main()
