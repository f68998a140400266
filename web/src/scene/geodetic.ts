import { Matrix4, Vector3 } from 'three';
import { WGS84_ELLIPSOID } from '3d-tiles-renderer/three';
import type { Vec3 } from './types.js';

/** A place on WGS 84; altitude above the ellipsoid [m]. */
export interface Geodetic {
  readonly latitude_deg: number;
  readonly longitude_deg: number;
  readonly altitude_m: number;
}

/** The place of map coordinates (east, north, up [m] of `origin`). */
export function toGeodetic([east, north, up]: Vec3, origin: Geodetic): Geodetic {
  const radians = Math.PI / 180;
  const frame = WGS84_ELLIPSOID.getEastNorthUpFrame(
    origin.latitude_deg * radians, origin.longitude_deg * radians, origin.altitude_m, new Matrix4());
  const place = { lat: 0, lon: 0, height: 0 };
  WGS84_ELLIPSOID.getPositionToCartographic(new Vector3(east, north, up).applyMatrix4(frame), place);
  return { latitude_deg: place.lat / radians, longitude_deg: place.lon / radians, altitude_m: place.height };
}
