import type { Kind, Theme } from './types.js';

/** Red, green, blue in 0..255 (sRGB). */
export type Rgb = readonly [number, number, number];

/** Lightness in [0, 1], and the two opponent colours. */
type Oklab = readonly [number, number, number];

/** A stop of a colour map: lightness [0, 1], chroma, hue [deg] in OKLCh. */
type Stop = readonly [lightness: number, chroma: number, hueDeg: number];

/** What a colour map is for: heights (many hues), amounts (one hue), or good against bad. */
export type RampName = 'height' | 'amount' | 'grey' | 'quality';

// The lightness of each map only rises or only falls, so that it can be read without hues, and differs from the
// background of its theme.
const kStops: Record<Theme, Record<RampName, readonly Stop[]>> = {
  dark: {
    height: [[0.46, 0.15, 285], [0.56, 0.13, 245], [0.68, 0.115, 200], [0.78, 0.15, 155], [0.87, 0.17, 120], [0.94, 0.145, 106]],
    amount: [[0.42, 0.09, 300], [0.55, 0.17, 345], [0.68, 0.17, 30], [0.8, 0.135, 66], [0.95, 0.09, 100]],
    grey: [[0.36, 0.012, 250], [0.97, 0.004, 250]],
    quality: [[0.55, 0.19, 20], [0.68, 0.15, 55], [0.78, 0.09, 110], [0.82, 0.12, 185], [0.88, 0.12, 205]],
  },
  light: {
    height: [[0.38, 0.15, 285], [0.47, 0.125, 255], [0.56, 0.09, 212], [0.63, 0.115, 158], [0.71, 0.145, 125], [0.79, 0.145, 95]],
    amount: [[0.8, 0.1, 75], [0.68, 0.15, 45], [0.55, 0.18, 20], [0.42, 0.16, 345], [0.3, 0.12, 300]],
    grey: [[0.22, 0.012, 250], [0.78, 0.006, 250]],
    quality: [[0.5, 0.19, 25], [0.58, 0.14, 55], [0.6, 0.09, 110], [0.52, 0.08, 185], [0.42, 0.09, 240]],
  },
};

/** Colours of points by kind. */
export const kKindColours: Record<Theme, Record<Kind, Rgb>> = {
  dark: { measured: [196, 206, 220], ground: [104, 122, 148], projected: [255, 122, 200], filled: [255, 196, 84] },
  light: { measured: [62, 74, 92], ground: [138, 152, 172], projected: [200, 20, 128], filled: [190, 116, 0] },
};

const kFine = 512;

/**
 * `steps` (at least 2) colours of a map from low to high, RGBA bytes.
 *
 * Perceptually uniform: any two neighbours are equally far apart in OKLab (Ottosson, "A perceptual color
 * space for image processing", 2020).
 */
export function ramp(name: RampName, steps: number, theme: Theme): Uint8Array {
  const fine = Array.from({ length: kFine }, (_, i) => along(kStops[theme][name], i / (kFine - 1)));
  const lengths = [0];
  for (let i = 1; i < kFine; ++i) {
    lengths.push((lengths[i - 1] as number) + difference(fine[i - 1] as Oklab, fine[i] as Oklab));
  }
  const bytes = new Uint8Array(4 * steps);
  let at = 0;
  for (let step = 0; step < steps; ++step) {
    const wanted = ((lengths[kFine - 1] as number) * step) / (steps - 1);
    while (at < kFine - 2 && (lengths[at + 1] as number) < wanted) ++at;
    const [low, high] = [lengths[at] as number, lengths[at + 1] as number];
    const colour = mix(fine[at] as Oklab, fine[at + 1] as Oklab, high > low ? (wanted - low) / (high - low) : 0);
    bytes.set([...toRgb(colour), 255], 4 * step);
  }
  return bytes;
}

/** Perceived distance of two colours; about 0.02 can just be distinguished. */
function difference(a: Oklab, b: Oklab): number {
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

// Colours outside the gamut are clamped; the stops are inside.
function toRgb([lightness, a, b]: Oklab): Rgb {
  const l = (lightness + 0.3963377774 * a + 0.2158037573 * b) ** 3;
  const m = (lightness - 0.1055613458 * a - 0.0638541728 * b) ** 3;
  const s = (lightness - 0.0894841775 * a - 1.291485548 * b) ** 3;
  return [
    byte(4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s),
    byte(-1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s),
    byte(-0.0041960863 * l - 0.7034186147 * m + 1.707614701 * s),
  ];
}

function along(stops: readonly Stop[], share: number): Oklab {
  const at = share * (stops.length - 1);
  const index = Math.min(Math.floor(at), stops.length - 2);
  return mix(fromStop(stops[index] as Stop), fromStop(stops[index + 1] as Stop), at - index);
}

function fromStop([lightness, chroma, hueDeg]: Stop): Oklab {
  const hue = (hueDeg * Math.PI) / 180;
  return [lightness, chroma * Math.cos(hue), chroma * Math.sin(hue)];
}

function mix(a: Oklab, b: Oklab, share: number): Oklab {
  return [a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share, a[2] + (b[2] - a[2]) * share];
}

function byte(value: number): number {
  const share = value <= 0.0031308 ? 12.92 * value : 1.055 * value ** (1 / 2.4) - 0.055;
  return Math.round(255 * Math.min(Math.max(share, 0), 1));
}
