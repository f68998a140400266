import type { Pose } from './pose.js';
import type { Status } from './words.js';

/** A vehicle's session, as shown to operators. */
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

/** A vehicle without a scan for longer than this is shown in grey [s]. */
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

/** What `watchFleet` needs from its surroundings, so that tests can replace it. */
export interface FleetWorld {
  ask(): Promise<Vehicle[]>;
  visible(): boolean;
  after(ms: number, then: () => void): () => void;
}

const kEvery_ms = 1000;
const kSlowest_ms = 15_000;

/**
 * Asks for the vehicles every second while the page is visible, and after failures less and less often.
 *
 * @param told   called with each list.
 * @param failed called with each failure; the last list stays valid.
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
