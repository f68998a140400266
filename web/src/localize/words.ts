/** The stable words of a pose's `reasons`, for people. */
const kReasons: Record<string, string> = {
  ambiguous: 'Another place in the map fits this scan as well.',
  clock_set_back: 'Stamps before this one were ahead of time; the session has begun anew.',
  coasting: 'The scan was not matched; this is where the vehicle should be by its motion.',
  contradicts_motion: 'The match contradicts how the vehicle moved before.',
  contradicts_prior: 'The match contradicts the prior and how sure it was.',
  large_covariance: 'The pose is not known well enough.',
  little_overlap: 'Too little of what the scan sees is in the map.',
  low_inlier_ratio: 'Too little of the scan lies on surfaces of the map: much has changed, or it is another place.',
  needs_prior: 'This map, or this method, cannot be searched without a prior.',
  not_deskewed: 'The scan was taken on the move and does not say when its points were; send their times, or deskew it.',
  not_converged: 'The alignment did not settle.',
  not_tracked: 'The vehicle was lost; the next scans look for it in a wider area.',
  outside_map: 'The prior lies outside the map.',
  too_few_points: 'The scan has too few points.',
  too_little_structure: 'There is too little around that stands upright to hold on to.',
  too_old: 'The scan is older than what the session still remembers.',
  unconfirmed: 'Found again; the next scan must confirm it.',
  unobservable_direction: 'The surroundings leave a direction free.',
};

export const reasonWords = (reason: string): string => kReasons[reason] ?? reason.replaceAll('_', ' ');

export type Status = 'ok' | 'degraded' | 'lost';

export const kStatusWords: Record<Status, { title: string; meaning: string }> = {
  ok: { title: 'Found', meaning: 'The pose is as good as its covariance says.' },
  degraded: { title: 'Found, with doubts', meaning: 'Weakly held or poorly supported: do not rely on it alone.' },
  lost: { title: 'Not found', meaning: 'No pose: the scan could not be placed in this map.' },
};

/** Metres with as many digits as they are worth: `4 mm`, `12 cm`, `3.21 m`; a dash where there is none. */
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
