#!/usr/bin/env python3
"""Makes the program's weights of a training run: batch normalization folded in, scores calibrated
on scans kept for that.

    export.py --run RUN --data DATA -o default.safetensors

A score becomes the share of boxes of this score that overlap an object (BEV IoU 0.5 for vehicles,
0.3 for others): for each class p = sigmoid(scale * logit + shift), then p^(1 - a) * iou^a (paper's
head with IoU; a as CIA-SSD has it), scale, shift and a by maximum likelihood.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

import argparse
import json
import pathlib

import losses
import network
import numpy as np
import safetensors
import scans as scan_files
import torch
import validate

# Below it a box is not looked at; above it, boxes of one place suppress each other.
LOWEST = 0.03


def outcomes(net, dataset, config):
    """(class in flat order, logit, iou said, whether right) of the boxes of all scans."""
    names = [name for head in config["heads"] for name in head["classes"]]
    rows = []
    for scan in dataset:
        features, sites = scan_files.voxels(scan.points, config)
        sites = torch.cat([torch.zeros(len(sites), 1, dtype=torch.int64), torch.tensor(sites)], 1)
        with torch.no_grad():
            results, places = net(torch.tensor(features), sites)
        boxes, kinds, logits, ious = [], [], [], []
        for head, result in zip(config["heads"], results):
            box = losses.decoded(result, places[:, 1:], config)
            for c, name in enumerate(head["classes"]):
                keep = result["hm"][:, c].sigmoid() > LOWEST
                boxes.append(box[keep])
                kinds += [names.index(name)] * int(keep.sum())
                logits.append(result["hm"][keep, c])
                ious.append(((result["iou"][keep, 0] + 1) / 2).clamp(1e-4, 1.0))
        boxes, logits, ious = torch.cat(boxes), torch.cat(logits), torch.cat(ious)
        order = (logits.sigmoid() * ious).argsort(descending=True)[:400].tolist()
        taken = suppressed_rows(boxes, order, config["nms_iou"])
        rows += judged(scan, boxes, taken, kinds, logits, ious, names)
    return np.array(rows)


def suppressed_rows(boxes, order, limit):
    kept = []
    for i in order:
        near = [j for j in kept if float((boxes[j, :2] - boxes[i, :2]).norm()) < 12.0]
        if near:
            one = boxes[i:i + 1].expand(len(near), 7)
            if float(losses.ground_plane_iou(one, boxes[near], 12).max()) > limit:
                continue
        kept.append(i)
    return kept


def judged(scan, boxes, taken, kinds, logits, ious, names):
    truth = torch.tensor(scan.boxes)
    countable = scan.counts() >= losses.MIN_POINTS
    truth_names = [scan_files.LEARNED.get(scan_files.OBJECT_CLASSES[c], "") for c in scan.classes]
    rows = []
    for i in taken:
        vehicle = names[kinds[i]] in validate.VEHICLES
        group = "vehicle" if vehicle else names[kinds[i]]
        theirs = [j for j, n in enumerate(truth_names) if validate.in_group(n, group)]
        best, best_j = 0.0, -1
        if theirs:
            one = boxes[i:i + 1].expand(len(theirs), 7)
            values = losses.ground_plane_iou(one, truth[theirs], 24)
            best, best_j = float(values.max()), theirs[int(values.argmax())]
        right = best >= (0.5 if vehicle else 0.3)
        if right and not countable[best_j]:
            continue  # neither right nor wrong
        rows.append((kinds[i], float(logits[i]), float(ious[i]), float(right)))
    return rows


def fitted(logit, iou, right):
    """scale, shift, a of one class by maximum likelihood."""
    logit, iou, right = (torch.tensor(v, dtype=torch.float64) for v in (logit, iou, right))
    best = None
    for a in (0.0, 0.2, 0.4, 0.6):
        parameters = torch.tensor([1.0, 0.0], dtype=torch.float64, requires_grad=True)
        optimizer = torch.optim.LBFGS([parameters], max_iter=100, line_search_fn="strong_wolfe")

        def loss():
            p = (parameters[0] * logit + parameters[1]).sigmoid().clamp(1e-6, 1 - 1e-6)
            p = (p ** (1 - a) * iou**a).clamp(1e-6, 1 - 1e-6)
            return -(right * p.log() + (1 - right) * (1 - p).log()).mean()

        def closure():
            optimizer.zero_grad()
            value = loss()
            value.backward()
            return value

        optimizer.step(closure)
        value = float(loss())
        if best is None or value < best[0]:
            scale, shift = parameters.detach().tolist()
            best = value, scale, shift, a
    return best


def calibrate(net, dataset, config):
    rows = outcomes(net, dataset, config)
    flat = 0
    for head in config["heads"]:
        for name in head["classes"]:
            mine = rows[rows[:, 0] == flat]
            # A handful of boxes says nothing; then the scores stay as they are.
            if len(mine) >= 50 and 10 <= mine[:, 3].sum() < len(mine):
                value, scale, shift, a = fitted(mine[:, 1], mine[:, 2], mine[:, 3])
                config["calibration"][flat] = [round(scale, 4), round(shift, 4)]
                config["iou_rectifier"][flat] = a
                print(f"{name}: {len(mine)} boxes, {mine[:, 3].mean():.2f} right, scale {scale:.2f} "
                      f"shift {shift:.2f} a {a} loss {value:.4f}")
            flat += 1


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--run", type=pathlib.Path, required=True)
    parser.add_argument("--data", type=pathlib.Path, required=True)
    parser.add_argument("-o", "--output", type=pathlib.Path, required=True)
    parser.add_argument("--threshold", type=float, default=None, help="score threshold to store")
    parser.add_argument("--half", action="store_true", help="store half precision")
    arguments = parser.parse_args()
    content = torch.load(arguments.run / "checkpoint.pt", map_location="cpu")
    # Checkpoints may be older than the key.
    config = {"pruning": [0.0] * 5, **content["config"]}
    config["iou_rectifier"] = [0.0] * len(config["iou_rectifier"])
    if arguments.threshold is not None:
        config["score_threshold"] = arguments.threshold
    net = network.VoxelNext(config)
    net.load_state_dict(content["net"])
    net.eval()
    calibrate(net, [f[i] for f, i in scan_files.open_scans(arguments.data, "calibration")], config)
    dtype = np.float16 if arguments.half else np.float32
    tensors = {name: value.numpy().astype(dtype) for name, value in net.folded().items()}
    safetensors.save(arguments.output, tensors,
                     {"format": "stillmap-voxelnext", "version": "1", "config": json.dumps(config)})
    print(f"{arguments.output}: {arguments.output.stat().st_size} bytes, step {content['step']}")


if __name__ == "__main__":
    main()
