import { Matrix4, Quaternion, Vector3 } from 'three';

export type Vec3 = [number, number, number];

/** `T_map_lidar` as the API writes it: position [m] in the map frame, quaternion x, y, z, w. */
export interface Pose {
  position: Vec3;
  quaternion: [number, number, number, number];
}

export const quaternionOf = (pose: Pose): Quaternion => new Quaternion(...pose.quaternion).normalize();

/** Horizontal direction of the lidar's forward axis [rad], counter-clockwise from the map's +x. */
export function headingOf(pose: Pose): number {
  const forward = new Vector3(1, 0, 0).applyQuaternion(quaternionOf(pose));
  return Math.atan2(forward.y, forward.x);
}

/**
 * The pose at a place whose forward axis points along a heading.
 *
 * @param up  the lidar's z axis in the map frame, not horizontal: keeps the slope of the road there.
 */
export function poseWithHeading(position: Vec3, heading_rad: number, up: Vec3 = [0, 0, 1]): Pose {
  const z = new Vector3(...up).normalize();
  // The direction with this heading in the plane that is normal to `up`.
  const [dx, dy] = [Math.cos(heading_rad), Math.sin(heading_rad)];
  const x = new Vector3(dx, dy, -(z.x * dx + z.y * dy) / z.z).normalize();
  const R = new Matrix4().makeBasis(x, new Vector3().crossVectors(z, x), z);
  const q = new Quaternion().setFromRotationMatrix(R);
  return { position, quaternion: [q.x, q.y, q.z, q.w] };
}

/** Interpolates between two poses, `share` in [0, 1]. */
export function between(from: Pose, to: Pose, share: number): Pose {
  const p = new Vector3(...from.position).lerp(new Vector3(...to.position), share);
  const q = quaternionOf(from).slerp(quaternionOf(to), share);
  return { position: [p.x, p.y, p.z], quaternion: [q.x, q.y, q.z, q.w] };
}

/** Easing of the animation: fast at first, slow at the end, in [0, 1]. */
export function easeOut(share: number): number {
  const left = 1 - Math.min(1, Math.max(0, share));
  return 1 - left * left * left;
}
