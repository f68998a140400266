import type { Start } from './request.js';

/** A GNSS position as typed; kept as text, so that incomplete numbers are not lost. */
export interface GnssText {
  latitude: string;
  longitude: string;
  altitude: string;
  sigma: string;
}

/** NaN for a text that is not a number, also for an empty one. */
export const numberOf = (text: string): number => (text.trim() === '' ? Number.NaN : Number(text));

/** The typed position, or what is wrong with it. The bounds are the server's. */
export function readGnss(text: GnssText): Start | string {
  const latitude_deg = numberOf(text.latitude);
  const longitude_deg = numberOf(text.longitude);
  const sigma_m = numberOf(text.sigma);
  const altitude_m = text.altitude.trim() === '' ? null : numberOf(text.altitude);
  if (!(Math.abs(latitude_deg) <= 90)) return 'Enter a latitude from -90 to 90 degrees.';
  if (!(Math.abs(longitude_deg) <= 180)) return 'Enter a longitude from -180 to 180 degrees.';
  if (altitude_m !== null && !Number.isFinite(altitude_m)) return 'Enter the altitude in metres above the ellipsoid, or nothing.';
  if (!(sigma_m >= 0.01 && sigma_m <= 1000)) return 'Enter a standard deviation from 0.01 to 1000 metres.';
  return { kind: 'gnss', latitude_deg, longitude_deg, altitude_m, sigma_m };
}
