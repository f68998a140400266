import { Matrix3, Matrix4, Vector3 } from 'three';
import { quaternionOf, type Pose } from './pose.js';

/** A covariance seen from above, in the map frame. All lengths are one standard deviation. */
export interface Uncertainty {
  major_m: number;
  minor_m: number;
  /** Direction of the major axis [rad], counter-clockwise from the map's +x, in (-pi/2, pi/2]. */
  angle_rad: number;
  vertical_m: number;
  yaw_rad: number;
}

/**
 * The horizontal ellipse of a pose's covariance.
 *
 * @param covariance  6 x 6 row by row, tx ty tz [m] rx ry rz [rad]; perturbation on the right, in the
 *                    lidar frame, so that R_map_lidar takes its blocks into the map frame.
 */
export function uncertaintyOf(pose: Pose, covariance: readonly number[]): Uncertainty {
  const position = turnedBlock(pose, covariance, 0);
  const rotation = turnedBlock(pose, covariance, 3);
  const [xx, xy, yy] = [position(0, 0), position(0, 1), position(1, 1)];
  const middle = (xx + yy) / 2;
  const reach = Math.hypot((xx - yy) / 2, xy);
  return {
    major_m: Math.sqrt(middle + reach),
    minor_m: Math.sqrt(Math.max(0, middle - reach)),
    angle_rad: reach === 0 ? 0 : Math.atan2(2 * xy, xx - yy) / 2,
    vertical_m: Math.sqrt(position(2, 2)),
    yaw_rad: Math.sqrt(rotation(2, 2)),
  };
}

/** A 3 x 3 block of the diagonal, from the lidar's axes to the map's: R S R^T. */
function turnedBlock(pose: Pose, covariance: readonly number[], begin: 0 | 3): (row: number, column: number) => number {
  const at = (row: number, column: number): number => covariance[6 * (begin + row) + begin + column]!;
  const S = new Matrix3().set(
    at(0, 0), at(0, 1), at(0, 2), at(1, 0), at(1, 1), at(1, 2), at(2, 0), at(2, 1), at(2, 2));
  const R = new Matrix3().setFromMatrix4(new Matrix4().makeRotationFromQuaternion(quaternionOf(pose)));
  const turned = R.clone().multiply(S).multiply(R.clone().transpose());
  return (row, column) => turned.elements[3 * column + row]!;
}

/** A direction that the scan does not constrain. */
export interface FreeDirection {
  /** Of sliding, in the map frame; its length is the share of it in the direction, 0 to 1. */
  slide: Vector3;
  /** Axis of turning in the map frame; its length is the share of it. */
  turn: Vector3;
  words: string;
}

/** @param direction  unit 6-vector in the covariance's order and frame, as the API gives it. */
export function freeDirection(pose: Pose, direction: readonly number[]): FreeDirection {
  const [x = 0, y = 0, z = 0, rx = 0, ry = 0, rz = 0] = direction;
  const q = quaternionOf(pose);
  return {
    slide: new Vector3(x, y, z).applyQuaternion(q),
    turn: new Vector3(rx, ry, rz).applyQuaternion(q),
    words: directionWords([x, y, z], [rx, ry, rz]),
  };
}

function directionWords(slide: number[], turn: number[]): string {
  const strongest = (values: number[]): number => values.reduce((best, v, i) => (Math.abs(v) > Math.abs(values[best]!) ? i : best), 0);
  const slides = Math.hypot(...slide) >= Math.hypot(...turn);
  const axis = strongest(slides ? slide : turn);
  return slides
    ? `can slide ${['forward or back', 'to the left or right', 'up or down'][axis]}`
    : `can turn ${['about its forward axis (roll)', 'nose up or down (pitch)', 'to the left or right (yaw)'][axis]}`;
}
