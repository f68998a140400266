/** Texts for the values of a pose's `reasons`. */
const kReasons: Record<string, string> = {
  ambiguous: 'Another place in the map fits this scan about as well. Send a prior with its covariance, or use a session.',
  clock_set_back: 'Earlier timestamps were in the future, so the session started again.',
  coasting: 'No match agrees with the motion, so the pose is the prediction. The session recovers by itself: send the next scan.',
  contradicts_motion: 'The match contradicts the previous motion of the vehicle. Check the odometry and the stamps.',
  contradicts_prior: 'The match contradicts the prior and its covariance. Check both.',
  interpolated: 'The scan came late, and its match does not agree. The pose lies between those of its neighbours.',
  large_covariance: 'The covariance is large. Use the pose with its covariance.',
  little_overlap: 'Too small a part of the scan is where the map knows anything. Check the prior, or map this place too.',
  low_inlier_ratio: 'Too few points lie on surfaces of the map: much has changed, or this is another place. Send a better prior, or rebuild the map.',
  needs_prior: 'This map or method needs a prior. Give one.',
  not_deskewed: 'The sensor moved during the scan, and the points have no times, or the method does not use them. Send point times to the default method, or deskew the scan first.',
  not_converged: 'The alignment did not converge. Send a better prior.',
  not_tracked: 'The vehicle was lost. The next scans search a wider area.',
  outside_map: 'The prior is outside the map. Check it, and whether it is in the frame of this map.',
  too_few_points: 'The scan has too few points. Send the whole scan, in metres.',
  too_little_structure: 'The surroundings have too few upright structures. Use a session with odometry.',
  too_old: 'The scan is older than the history of the session. Send scans sooner.',
  unconfirmed: 'The vehicle was found by a wide search. Send the next scan: it must confirm the place.',
  unobservable_direction: 'The surroundings do not fix the position along one direction, as in a long corridor. Use the covariance, or a session with odometry.',
};

export const reasonWords = (reason: string): string => kReasons[reason] ?? reason.replaceAll('_', ' ');

export type Status = 'ok' | 'degraded' | 'lost';

export const kStatusWords: Record<Status, { title: string; meaning: string }> = {
  ok: { title: 'Found', meaning: 'Use the pose with its covariance.' },
  degraded: { title: 'Uncertain', meaning: 'The pose is weakly supported: do not rely on it alone.' },
  lost: { title: 'Not found', meaning: 'The scan was not found in this map, so there is no pose.' },
};

/** Metres with a useful number of digits: `4 mm`, `12 cm`, `3.21 m`; a dash for null. */
export function lengthWords(metres: number | null): string {
  if (metres === null || !Number.isFinite(metres)) return '–';
  const size = Math.abs(metres);
  if (size < 0.0095) return `${(1000 * metres).toFixed(size < 0.00095 ? 1 : 0)} mm`;
  if (size < 0.995) return `${(100 * metres).toFixed(size < 0.095 ? 1 : 0)} cm`;
  return `${metres.toFixed(size < 99.5 ? 2 : 0)} m`;
}

export function angleWords(radians: number | null): string {
  if (radians === null || !Number.isFinite(radians)) return '–';
  const degrees = (radians * 180) / Math.PI;
  return `${degrees.toFixed(Math.abs(degrees) < 9.95 ? 2 : 1)}°`;
}
