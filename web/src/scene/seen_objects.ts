import type { Box } from './clip_box.js';

/** An entry of the server's list of removed objects: one for each place that an object was at. */
export interface ObjectEntry {
  readonly object: number;
  readonly scan: number;
  readonly centre: readonly number[];
  readonly size: readonly number[];
  readonly yaw: number;
  readonly class: string;
  readonly motion: string;
  readonly score: number;
  readonly first_scan: number;
  readonly last_scan: number;
  readonly points_removed: number;
}

/** An object with all places it was seen at, in the order of the scans; map coordinates [m]. */
export interface SeenObject {
  readonly number: number;
  readonly class: string;
  readonly motion: string;
  readonly score: number;
  readonly firstScan: number;
  readonly lastScan: number;
  readonly pointsRemoved: number;
  readonly places: readonly Box[];
}

/** Entries with the same number are one object. */
export function gather(entries: readonly ObjectEntry[]): SeenObject[] {
  const byNumber = new Map<number, ObjectEntry[]>();
  for (const entry of entries) {
    const known = byNumber.get(entry.object);
    if (known === undefined) byNumber.set(entry.object, [entry]);
    else known.push(entry);
  }
  return [...byNumber.values()].map((places) => {
    const first = places[0] as ObjectEntry;
    return {
      number: first.object, class: first.class, motion: first.motion, score: first.score,
      firstScan: first.first_scan, lastScan: first.last_scan, pointsRemoved: first.points_removed,
      places: [...places].sort((a, b) => a.scan - b.scan).map(({ centre, size, yaw }) => ({
        centre: [centre[0] ?? 0, centre[1] ?? 0, centre[2] ?? 0], size: [size[0] ?? 0, size[1] ?? 0, size[2] ?? 0], yaw,
      })),
    };
  });
}

/** Horizontal length of an object's track [m]. */
export function wayOf({ places }: SeenObject): number {
  return places.slice(1).reduce((sum, { centre }, i) => {
    const before = (places[i] as Box).centre;
    return sum + Math.hypot(centre[0] - before[0], centre[1] - before[1]);
  }, 0);
}
