import { Quaternion, Vector3 } from 'three';
import { headingOf, poseWithHeading, type Pose, type Vec3 } from './pose.js';

/** The recorded pose that is horizontally nearest to a place: a prior there gets its height and slope. */
function nearestPose(poses: readonly Pose[], place: Vec3): Pose | undefined {
  let best: { pose: Pose; distance: number } | undefined;
  for (const pose of poses) {
    const distance = Math.hypot(pose.position[0] - place[0], pose.position[1] - place[1]);
    if (best === undefined || distance < best.distance) best = { pose, distance };
  }
  return best?.pose;
}

/** Further away, the height of a recorded pose is not used [m]. */
const kNearPose_m = 25;
/** Usual height of a sensor over the ground [m], for places without a recorded pose nearby. */
const kSensorHeight_m = 1.8;

/** A prior at the pressed place with the dragged heading, at the height of the recorded poses there. */
export function priorAt(ground: Vec3, heading_rad: number, poses: readonly Pose[]): Pose {
  const near = nearestPose(poses, ground);
  const known = near !== undefined && Math.hypot(near.position[0] - ground[0], near.position[1] - ground[1]) <= kNearPose_m;
  if (!known) return poseWithHeading([ground[0], ground[1], ground[2] + kSensorHeight_m], heading_rad);
  const up = new Vector3(0, 0, 1).applyQuaternion(new Quaternion(...near.quaternion));
  return poseWithHeading([ground[0], ground[1], near.position[2]], heading_rad, [up.x, up.y, up.z]);
}

/** Heading of the recorded pose nearest to a place [rad]; along +x if there is none. */
export function usualHeading(place: Vec3, poses: readonly Pose[]): number {
  const near = nearestPose(poses, place);
  return near === undefined ? 0 : headingOf(near);
}
