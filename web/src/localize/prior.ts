import { Quaternion, Vector3 } from 'three';
import { headingOf, poseWithHeading, type Pose, type Vec3 } from './pose.js';

/** The recorded pose nearest to a place over ground: whose height and slope a prior there takes. */
function nearestPose(poses: readonly Pose[], place: Vec3): Pose | undefined {
  let best: { pose: Pose; distance: number } | undefined;
  for (const pose of poses) {
    const distance = Math.hypot(pose.position[0] - place[0], pose.position[1] - place[1]);
    if (best === undefined || distance < best.distance) best = { pose, distance };
  }
  return best?.pose;
}

/** Beyond this the height of the nearest recorded pose says nothing about a place [m]. */
const kNearPose_m = 25;
/** Usual height of a sensor over the ground [m], where nothing was recorded near by. */
const kSensorHeight_m = 1.8;

/** A prior where a person pressed, looking where they dragged to, at the height that the map was driven there. */
export function priorAt(ground: Vec3, heading_rad: number, poses: readonly Pose[]): Pose {
  const near = nearestPose(poses, ground);
  const known = near !== undefined && Math.hypot(near.position[0] - ground[0], near.position[1] - ground[1]) <= kNearPose_m;
  if (!known) return poseWithHeading([ground[0], ground[1], ground[2] + kSensorHeight_m], heading_rad);
  const up = new Vector3(0, 0, 1).applyQuaternion(new Quaternion(...near.quaternion));
  return poseWithHeading([ground[0], ground[1], near.position[2]], heading_rad, [up.x, up.y, up.z]);
}

/** Where vehicles looked who drove nearest to a place [rad]; along +x where nobody did. */
export function usualHeading(place: Vec3, poses: readonly Pose[]): number {
  const near = nearestPose(poses, place);
  return near === undefined ? 0 : headingOf(near);
}
