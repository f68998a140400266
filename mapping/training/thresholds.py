#!/usr/bin/env python3
"""Calibrates scores and chooses thresholds by what the whole program finds, boxes fitted to points.

    thresholds.py WEIGHTS DRIVE... --program build/release/stillmap

For vehicles, two-wheelers and pedestrians: the scores become the share of such boxes that are right (BEV IoU 0.5 for
vehicles, 0.3 for others), and the threshold of each class is that of the best F1. WEIGHTS is overwritten. The drives
are simulated, of seeds 20,000 and up. Classes whose scores contain the IoU branch keep their scores and only get a
threshold.
"""

import argparse
import json
import pathlib
import subprocess
import tempfile

import numpy as np
import safetensors

GROUPS = {"vehicle": ("car", "van", "truck", "bus"), "two_wheeler": ("cyclist",), "pedestrian": ("pedestrian",)}
LOWEST = 0.02


def sigmoid(x):
    return 1.0 / (1.0 + np.exp(-x))


def counts_of(evaluation, group):
    """Right boxes and all boxes with at least 0.01, 0.02, ... 0.99, and labelled objects."""
    truths = evaluation["counts"]["truths"].get(group, 0)
    right, boxes = np.zeros(99), np.zeros(99)
    for score, precision, recall in evaluation["curves"].get(group, {}).get("score_precision_recall", ()):
        row = round(100 * score) - 1
        right[row] = recall * truths
        boxes[row] = right[row] / precision if precision else right[row]
    return right, boxes, truths


def fitted(scores, right, wrong):
    """scale and shift of the logits of scores by maximum likelihood (Newton), held near 1 and 0 where boxes are few."""
    x = np.stack([np.log(scores / (1 - scores)), np.ones_like(scores)], 1)
    parameters, prior = np.array([1.0, 0.0]), np.eye(2)
    for _ in range(30):
        p = sigmoid(x @ parameters)
        gradient = x.T @ (right - (right + wrong) * p) - prior @ (parameters - [1.0, 0.0])
        curvature = (x.T * ((right + wrong) * p * (1 - p))) @ x + prior
        parameters = parameters + np.linalg.solve(curvature, gradient)
    return parameters


def evaluations_of(program, tensors, metadata, config, drives, select):
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "low.safetensors"
        low = json.dumps({**config, "score_threshold": LOWEST})
        safetensors.save(file, tensors, {**metadata, "config": low})
        for drive in drives:
            command = [program, "evaluate", "detector", drive, "--select", select,
                       "--detector", f"voxelnext:{file}", "--json"]
            yield json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("weights", type=pathlib.Path)
    parser.add_argument("drives", nargs="+")
    parser.add_argument("--program", required=True, help="stillmap")
    parser.add_argument("--select", default="::4")
    arguments = parser.parse_args()
    tensors, metadata = safetensors.load(arguments.weights)
    config = json.loads(metadata["config"])
    names = [name for head in config["heads"] for name in head["classes"]]
    thresholds = np.broadcast_to(config["score_threshold"], len(names)).tolist()
    results = list(evaluations_of(arguments.program, tensors, metadata, config, arguments.drives, arguments.select))
    scores = np.arange(1, 100) / 100
    for group, members in GROUPS.items():
        right, boxes, truths = (sum(values) for values in zip(*(counts_of(each, group) for each in results)))
        if truths == 0 or right.max() == 0:
            continue
        f1 = 2 * right / (boxes + truths)
        best = int(f1.argmax())
        # Between one score and the next.
        of_right, of_boxes = right - np.append(right[1:], 0), boxes - np.append(boxes[1:], 0)
        used = (scores >= LOWEST) & (of_boxes > 0)
        scale, shift = fitted(scores[used] + 0.005, of_right[used], (of_boxes - of_right)[used])
        calibrated = sigmoid(scale * np.log(scores / (1 - scores)) + shift)
        print(f"{group}: {truths:.0f} objects, scale {scale:.2f} shift {shift:.2f}, "
              f"best F1 {f1[best]:.3f} at {calibrated[best]:.2f}")
        for row in sorted({*range(4, 99, 10), best}):
            print(f"  score {scores[row]:.2f} now {calibrated[row]:.2f}: "
                  f"precision {right[row] / max(1, boxes[row]):.3f} recall {right[row] / truths:.3f} F1 {f1[row]:.3f}")
        for i in (i for i, name in enumerate(names) if name in members):
            thresholds[i] = float(scores[best])
            if config["iou_rectifier"][i] == 0:
                a, b = config["calibration"][i]
                config["calibration"][i] = [round(scale * a, 4), round(scale * b + shift, 4)]
                thresholds[i] = round(float(calibrated[best]), 2)
    config["score_threshold"] = thresholds
    safetensors.save(arguments.weights, tensors, {**metadata, "config": json.dumps(config)})


if __name__ == "__main__":
    main()
