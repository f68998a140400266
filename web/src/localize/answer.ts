import type { Schema } from '../api/client.js';
import type { Pose } from './pose.js';
import type { Status } from './words.js';

type Written = Omit<Schema<'PoseAnswer'>, 'warnings'>;

/** What the server says about one scan, as the view needs it. */
export interface Answer {
  status: Status;
  reasons: string[];
  pose: Pose | null;
  /** 36 numbers, or null when lost. */
  covariance: number[] | null;
  protection: Written['protection'];
  inlierRatio: number;
  rmse_m: number;
  degenerate: number[][];
  priorToPose: { m: number; rad: number } | null;
  iterations: number;
  version: string;
  timing_ms: Written['timing_ms'];
  requestId: string;
  /** Of sessions: from where it was searched. */
  searchedFrom: string | null;
}

/** @param written a `PoseAnswer`, or a `SessionPoseAnswer`. */
export function answerOf(written: Written & { searched_from?: string }): Answer {
  return {
    status: written.status,
    reasons: written.reasons,
    pose: written.pose as Pose | null,
    covariance: written.covariance,
    protection: written.protection,
    inlierRatio: written.inlier_ratio,
    rmse_m: written.rmse_m,
    degenerate: written.degenerate_directions,
    priorToPose: written.prior_to_pose,
    iterations: written.iterations,
    version: written.map.version,
    timing_ms: written.timing_ms,
    requestId: written.request_id,
    searchedFrom: written.searched_from ?? null,
  };
}
