import * as THREE from 'three';
import type { Tile } from '3d-tiles-renderer/core';
import { kFactsWord, kPointWords } from './point_layout.js';
import { Histogram } from './statistics.js';
import { kKinds, type Kind, type Range, type Vec3 } from './types.js';

/** Most points of a tile from which the colour ranges are computed. */
const kRangeSamples = 20_000;

/** A point that is shown. */
export interface PickedPoint {
  /** Map coordinates [m]. */
  readonly position: Vec3;
  readonly intensity: number;
  readonly observations: number;
  readonly kind: Kind;
  /** Level of detail: a point stands for a cube of voxel size times 2^level. */
  readonly level: number;
}

/** Ranges of most values of a map. */
export interface Ranges {
  readonly height: Range;
  readonly intensity: Range;
  readonly observations: Range;
}

/** The points of a tile as received: five words each, as numbers and as bits. */
export class TilePoints {
  readonly count: number;
  readonly floats: Float32Array;
  private readonly bits_: Uint32Array;

  /** What the points are relative to, itself relative to the map's origin [m]. */
  readonly corner: Vec3;
  readonly geometry: THREE.BufferGeometry;

  /** @param object from the glTF loader: one interleaved buffer, and y up. */
  constructor(
    object: THREE.Points,
    readonly level: number,
  ) {
    const { x, y, z } = object.position;
    this.corner = [x, -z, y];
    this.geometry = object.geometry;
    this.floats = (this.geometry.getAttribute('position') as THREE.InterleavedBufferAttribute).data.array as Float32Array;
    this.bits_ = new Uint32Array(this.floats.buffer, this.floats.byteOffset, this.floats.length);
    this.count = this.floats.length / kPointWords;
    this.share();
  }

  kind(index: number): Kind {
    return kKinds[(this.facts(index) >> 16) & 3] as Kind;
  }

  /** @param origin of the map: added in doubles, since map coordinates can be too large for floats. */
  point(index: number, origin: Vec3): PickedPoint {
    const at = index * kPointWords;
    const place = [0, 1, 2].map((axis) =>
      (this.floats[at + axis] as number) + (this.corner[axis] as number) + (origin[axis] as number)) as unknown as Vec3;
    return {
      position: place, intensity: this.floats[at + 3] as number, observations: this.facts(index) & 0xffff,
      kind: this.kind(index), level: this.level,
    };
  }

  /** From a sample of the points; undefined if the tile has none. Heights in map coordinates. */
  ranges(origin: Vec3): Ranges | undefined {
    const heights = new Histogram(0.1);
    const observations = new Histogram(1);
    // Sensors report 0 to 1, or 0 to 255 and more.
    const intensities = new Histogram(this.largestIntensity() > 2 ? 1 : 0.005);
    const step = Math.max(1, Math.floor(this.count / kRangeSamples));
    for (let i = 0; i < this.count; i += step) {
      heights.add((this.floats[i * kPointWords + 2] as number) + this.corner[2] + origin[2]);
      intensities.add(this.floats[i * kPointWords + 3] as number);
      observations.add(this.facts(i) & 0xffff);
    }
    const [height, intensity, seen] = [heights.range(0.01, 1), intensities.range(0.02, 0.01), observations.range(0.02, 1)];
    if (height === undefined || intensity === undefined || seen === undefined) return undefined;
    return { height, intensity, observations: { low: Math.max(seen.low, 1), high: Math.max(seen.high, 2) } };
  }

  // The loader copies the whole buffer for each number type. One copy is enough here.
  private share(): void {
    const interleaved = new THREE.InterleavedBuffer(this.floats, kPointWords);
    this.geometry.setAttribute('position', new THREE.InterleavedBufferAttribute(interleaved, 3, 0));
    this.geometry.setAttribute('_intensity', new THREE.InterleavedBufferAttribute(interleaved, 1, 3));
    const packed = new Uint32Array(this.count);
    for (let i = 0; i < this.count; ++i) packed[i] = this.facts(i);
    this.geometry.setAttribute('_point', new THREE.BufferAttribute(new Uint8Array(packed.buffer), 4));
  }

  private facts(index: number): number {
    return this.bits_[index * kPointWords + kFactsWord] as number;
  }

  private largestIntensity(): number {
    let most = 0;
    for (let at = 3; at < this.floats.length; at += kPointWords) most = Math.max(most, this.floats[at] as number);
    return most;
  }
}

/** Level of detail of a tile: that of `3/-1/0.glb` is 3. */
export function levelOf(tile: Tile): number {
  const uri = (tile.content as { uri?: string } | undefined)?.uri ?? '';
  return Number(/(\d+)\/-?\d+\/-?\d+\.glb/.exec(uri)?.[1] ?? 0);
}
