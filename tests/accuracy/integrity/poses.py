"""Rigid transformations as 4 x 4 arrays, and the files that hold them."""

import numpy as np


def hat(w):
    """The 3 x 3 matrix of the cross product with `w` (3)."""
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


def _left_jacobian(w):
    angle = np.linalg.norm(w)
    W = hat(w)
    if angle < 1e-6:
        return np.eye(3) + W / 2.0 + W @ W / 6.0
    return (np.eye(3) + (1.0 - np.cos(angle)) / angle**2 * W
            + (angle - np.sin(angle)) / angle**3 * W @ W)


def exp_rotation(w):
    return np.eye(3) + hat(w) @ _left_jacobian(w)


def log_rotation(R):
    """Rotation vector (3) of R; the angle in [0, pi)."""
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine = np.linalg.norm(axis) / 2.0
    angle = np.arctan2(sine, (np.trace(R) - 1.0) / 2.0)
    if sine > 1e-9:
        return axis * (angle / (2.0 * sine))
    if angle < 1.0:
        return axis / 2.0
    # Half a turn: the axis is the eigenvector of eigenvalue 1.
    values, vectors = np.linalg.eigh((R + R.T) / 2.0)
    return vectors[:, np.argmax(values)] * angle


def exp_se3(e):
    """T of the twist `e` (6: translation, rotation)."""
    T = np.eye(4)
    T[:3, :3] = exp_rotation(e[3:])
    T[:3, 3] = _left_jacobian(e[3:]) @ e[:3]
    return T


def log_se3(T):
    """Twist (6: translation, rotation) of T; inverse of `exp_se3` below half a turn."""
    w = log_rotation(T[:3, :3])
    return np.concatenate([np.linalg.solve(_left_jacobian(w), T[:3, 3]), w])


def yawed(yaw_rad):
    T = np.eye(4)
    T[:3, :3] = exp_rotation(np.array([0.0, 0.0, yaw_rad]))
    return T


def read_kitti(file):
    """N x 4 x 4 from lines of 12 numbers."""
    rows = np.loadtxt(file, ndmin=2)
    if rows.shape[1] != 12:
        raise ValueError(f"{file}: {rows.shape[1]} numbers a line, expected 12")
    T = np.tile(np.eye(4), (len(rows), 1, 1))
    T[:, :3] = rows.reshape(-1, 3, 4)
    return T


def write_kitti(file, T):
    np.savetxt(file, np.asarray(T)[:, :3].reshape(-1, 12), fmt="%.12e")


def read_calibration(file):
    """T_cam_lidar of an odometry `calib.txt`."""
    for line in file.read_text().splitlines():
        key, _, numbers = line.partition(":")
        if key == "Tr":
            T = np.eye(4)
            T[:3] = np.array(numbers.split(), float).reshape(3, 4)
            return T
    raise ValueError(f"{file}: no line 'Tr:'")
