/** Texts for the values of a pose's `reasons`. */
const kReasons: Record<string, string> = {
  ambiguous: 'Another place in the map fits this scan equally well. Give a prior.',
  clock_set_back: 'Earlier timestamps were in the future, so the session started again.',
  coasting: 'The scan was not matched. The pose is predicted from the motion.',
  contradicts_motion: 'The match contradicts the previous motion of the vehicle.',
  contradicts_prior: 'The match contradicts the prior and its covariance.',
  interpolated: 'The scan came late and was not matched. The pose lies between those of its neighbours.',
  large_covariance: 'The covariance is too large.',
  little_overlap: 'Too small a part of the scan is inside the map.',
  low_inlier_ratio: 'Too few points lie on surfaces of the map: much has changed, or this is another place.',
  needs_prior: 'This map or method needs a prior. Give one.',
  not_deskewed: 'The sensor moved during the scan, and the points have no times. Send point times, or deskew the scan first.',
  not_converged: 'The alignment did not converge.',
  not_tracked: 'The vehicle was lost. The next scans search a wider area.',
  outside_map: 'The prior is outside the map.',
  too_few_points: 'The scan has too few points.',
  too_little_structure: 'The surroundings have too few upright structures.',
  too_old: 'The scan is older than the history of the session.',
  unconfirmed: 'The vehicle was found again. The next scan must confirm it.',
  unobservable_direction: 'The surroundings do not constrain one direction.',
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
