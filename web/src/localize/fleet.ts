import type { Pose } from './pose.js';
import type { Status } from './words.js';

/** A vehicle's session as operators see it. */
export interface Vehicle {
  /** Not the session's name, which is its secret. */
  label: string;
  map: string;
  version: string;
  status: Status | null;
  reasons: string[];
  pose: Pose | null;
  covariance: number[] | null;
  scans: number;
  idle_s: number;
}

/** Without a scan for longer than this a vehicle is greyed [s]. */
export const kStale_s = 5;

const isStale = (vehicle: Vehicle): boolean => vehicle.idle_s > kStale_s;

/** How the picture and the list show a vehicle. */
export type Look = Status | 'stale' | 'new';

export function lookOf(vehicle: Vehicle): Look {
  if (vehicle.status === null) return 'new';
  return isStale(vehicle) ? 'stale' : vehicle.status;
}

export interface FleetWatch {
  stop(): void;
}

/** What `watchFleet` needs of the world, so that a test can stand in for it. */
export interface FleetWorld {
  ask(): Promise<Vehicle[]>;
  visible(): boolean;
  after(ms: number, then: () => void): () => void;
}

const kEvery_ms = 1000;
const kSlowest_ms = 15_000;

/**
 * Asks for the vehicles every second while the page is seen; after failures less and less often.
 *
 * @param told   with each list.
 * @param failed with each failure; the list before stays as it was.
 */
export function watchFleet(world: FleetWorld, told: (vehicles: Vehicle[]) => void, failed: (error: unknown) => void): FleetWatch {
  let stopped = false;
  let wait = kEvery_ms;
  let cancel = (): void => undefined;
  const ask = async (): Promise<void> => {
    if (world.visible()) {
      try {
        const vehicles = await world.ask();
        wait = kEvery_ms;
        if (!stopped) told(vehicles);
      } catch (error) {
        wait = Math.min(2 * wait, kSlowest_ms);
        if (!stopped) failed(error);
      }
    }
    if (!stopped) cancel = world.after(wait, () => void ask());
  };
  void ask();
  return {
    stop: () => {
      stopped = true;
      cancel();
    },
  };
}
