import * as THREE from 'three';
import type { Tile } from '3d-tiles-renderer/core';
import { TilesRenderer } from '3d-tiles-renderer/three';
import { askForKey } from '../api/keys.js';
import { onRecovery } from '../api/recovery.js';
import { CloudBudget, type CountedTileset } from './cloud_budget.js';
import { contains } from './clip_box.js';
import type { Clip } from './clip_planes.js';
import { PickPoints, type Hit, type Ray } from './pick.js';
import { kPointWords } from './point_layout.js';
import { PointMaterials } from './point_materials.js';
import { levelOf, TilePoints, type PickedPoint, type Ranges } from './tile_points.js';
import { isPassing, TileSource, type Ask, type Trouble } from './tile_source.js';
import { add, kKinds, subtract, type Kind, type Vec3 } from './types.js';

export type { PickedPoint, Ranges } from './tile_points.js';

/** Most bytes of tiles that are kept (as the library counts them: 20 a point). */
const kCacheBytes = 200e6;
const kDownloadsAtOnce = 6;
/** Most points tested for one pick, so that it takes less than a frame. */
const kPickLimit = 400_000;

/** Number of boxes that describe the shape of a map. */
const kShapeBoxes = 100;

export interface MapCloudOptions {
  /** Of the version's tileset.json. */
  readonly tilesetUrl: string;
  /** Origin of the map in map coordinates [m], from which tiles are placed. */
  readonly origin: Vec3;
  /** Spacing of the finest points [m]. */
  readonly voxelSizeM: number;
  readonly ask: Ask;
  /** Something new can be drawn. */
  readonly onChange: () => void;
  readonly onTrouble: (trouble: Trouble | undefined) => void;
}

interface Loaded {
  readonly points: TilePoints;
  /** Made at the first pick. */
  pick?: PickPoints;
}

/**
 * The points of one map version, streamed by level of detail within a budget.
 *
 * Must be added to a Scene. `ready` resolves when the tileset is loaded (not its points).
 */
export class MapCloud {
  /** Points in the frame of the scene it was added to. */
  readonly group = new THREE.Group();
  readonly materials: PointMaterials;
  readonly ready: Promise<void>;
  /** Points drawn at most. */
  budget = 3_000_000;
  private budget_: CloudBudget | undefined;
  private readonly source_: TileSource;
  private readonly stop_ = new AbortController();
  private readonly forget_: () => void;
  private tiles_: TilesRenderer | undefined;
  private readonly loaded_ = new Map<Tile, Loaded>();
  private ranges_: Ranges | undefined;
  private kinds_: ReadonlySet<Kind> = new Set(kKinds);
  private clip_: Clip | undefined;
  private shown_ = true;

  constructor(private readonly options_: MapCloudOptions) {
    this.materials = new PointMaterials(options_.voxelSizeM);
    this.source_ = new TileSource(options_.ask, options_.onTrouble);
    this.ready = this.load();
    this.ready.catch(() => undefined);
    this.forget_ = onRecovery(() => isPassing(this.source_.trouble) && this.source_.retry());
  }

  get origin(): Vec3 {
    return this.options_.origin;
  }

  /** Bounds in map coordinates [m]; undefined before the tileset is known. */
  get bounds(): { min: Vec3; max: Vec3 } | undefined {
    const box = new THREE.Box3();
    if (this.tiles_ === undefined || !this.tiles_.getBoundingBox(box)) return undefined;
    const [x, y, z] = this.origin;
    return {
      min: [box.min.x + x, box.min.y + y, box.min.z + z], max: [box.max.x + x, box.max.y + y, box.max.z + z],
    };
  }

  /** Corners [m, map coordinates] of boxes that contain all points, tighter than `bounds`; empty before the tileset is loaded. */
  get shape(): Vec3[] {
    let boxes = this.tiles_?.root === null || this.tiles_ === undefined ? [] : [this.tiles_.root as Tile];
    for (;;) {
      const finer = boxes.flatMap((tile) => ((tile.children ?? []).length > 0 ? (tile.children as Tile[]) : [tile]));
      if (finer.length > kShapeBoxes || finer.length === boxes.length) break;
      boxes = finer;
    }
    return boxes.flatMap((tile) => cornersOf(tile, this.origin));
  }

  /** Undefined until the first tile is there; heights in map coordinates. */
  get ranges(): Ranges | undefined {
    return this.ranges_;
  }

  /** Points and tiles that are drawn, kept and being loaded. */
  get stats(): { points: number; tiles: number; bytes: number; pending: number } {
    const tiles = this.tiles_;
    if (tiles === undefined) return { points: 0, tiles: 0, bytes: 0, pending: 1 };
    let points = 0;
    for (const tile of tiles.visibleTiles) points += this.loaded_.get(tile)?.points.count ?? 0;
    // Fields that are documented but not declared by the library.
    const { stats, lruCache } = tiles as unknown as {
      stats: { queued: number; downloading: number; parsing: number }; lruCache: { cachedBytes: number };
    };
    const pending = stats.queued + stats.downloading + stats.parsing;
    return { points, tiles: tiles.visibleTiles.size, bytes: lruCache.cachedBytes, pending };
  }

  setKinds(kinds: ReadonlySet<Kind>): void {
    this.kinds_ = new Set(kinds);
    this.materials.setKinds(kinds);
    this.shown_ = kinds.size > 0;
    if (this.tiles_ !== undefined) this.tiles_.group.visible = this.shown_;
  }

  /** Hides what the box cuts away; hidden points cannot be picked. @param clip in the frame of the scene */
  setClip(clip: Clip | undefined): void {
    this.clip_ = clip;
    this.materials.setClip(clip);
  }

  /** Tries again after an error. If a key is missing, asks for it first. */
  retry(): void {
    if (this.source_.trouble?.kind === 'key') askForKey();
    else this.source_.retry();
  }

  /** Places the cloud in a scene with the origin `sceneOrigin` (map coordinates). */
  place(sceneOrigin: Vec3): void {
    this.group.position.set(...subtract(this.origin, sceneOrigin));
    this.group.updateMatrixWorld(true);
  }

  /** Chooses the tiles for a view, and loads the missing ones. @param height of the picture [px]. */
  update(camera: THREE.Camera, width: number, height: number): void {
    const tiles = this.tiles_;
    if (tiles === undefined) return;
    for (const before of tiles.cameras.filter((one) => one !== camera)) tiles.deleteCamera(before);
    tiles.setCamera(camera);
    tiles.setResolution(camera, width, height);
    if (this.budget_ !== undefined) tiles.errorTarget = this.budget_.errorTarget(tiles, this.budget);
    tiles.update();
  }

  /**
   * The point at a ray.
   *
   * @param ray       in the frame of the scene.
   * @param tolerance slope of the cone around it.
   */
  pick(ray: Ray, tolerance: number): (PickedPoint & { depth: number }) | undefined {
    const { x, y, z } = this.group.position;
    const own: Ray = { origin: subtract(ray.origin, [x, y, z]), direction: ray.direction };
    let left = kPickLimit;
    let best: { hit: Hit; loaded: Loaded } | undefined;
    for (const loaded of this.alongRay(own, tolerance)) {
      if (left <= 0) break;
      const { points } = loaded;
      loaded.pick ??= new PickPoints(points.floats, kPointWords, points.count);
      const inTile: Ray = { origin: subtract(own.origin, points.corner), direction: own.direction };
      const { hit, looked } = loaded.pick.nearest(inTile, tolerance, (i) => this.isSeen(points, i), left);
      left -= looked;
      if (hit !== undefined && (best === undefined || hit.depth < best.hit.depth)) best = { hit, loaded };
    }
    return best === undefined ? undefined : { ...best.loaded.points.point(best.hit.index, this.origin), depth: best.hit.depth };
  }

  dispose(): void {
    this.forget_();
    this.stop_.abort();
    this.tiles_?.dispose();
    this.materials.dispose();
    this.group.removeFromParent();
  }

  private async load(): Promise<void> {
    const tileset = (await this.source_.json(this.options_.tilesetUrl, this.stop_.signal)) as CountedTileset;
    // The library warns for every version above 1.0. Of 1.1 we use glTF content only, which it supports.
    tileset.asset.version = '1.0';
    const tiles = new TilesRenderer(this.options_.tilesetUrl);
    tiles.registerPlugin({
      fetchData: (url: string, { signal = this.stop_.signal }: { signal?: AbortSignal }) =>
        url === this.options_.tilesetUrl ? Promise.resolve(tileset)
          : url.endsWith('.json') ? this.nested(url, signal) : this.source_.bytes(url, signal),
      processTileModel: (scene: THREE.Object3D, tile: Tile) => this.prepare(scene, tile),
    });
    Object.assign(tiles.lruCache, { minBytesSize: 0.7 * kCacheBytes, maxBytesSize: kCacheBytes });
    tiles.downloadQueue.maxJobsPerOrigin = kDownloadsAtOnce;
    tiles.addEventListener('load-model', ({ scene, tile }) => this.show(scene, tile));
    tiles.addEventListener('dispose-model', ({ tile }) => this.loaded_.delete(tile));
    tiles.addEventListener('needs-update', () => this.options_.onChange());
    tiles.addEventListener('tile-visibility-change', () => this.options_.onChange());
    tiles.group.visible = this.shown_;
    this.group.add(tiles.group);
    this.tiles_ = tiles;
    this.budget_ = new CloudBudget(tileset, (tile) => this.loaded_.get(tile)?.points.count);
    this.options_.onChange();
    await new Promise<void>((resolve) => tiles.addEventListener('load-root-tileset', () => resolve()));
  }

  private async nested(url: string, signal: AbortSignal): Promise<unknown> {
    const tileset = (await this.source_.json(url, signal)) as { asset: { version: string } };
    tileset.asset.version = '1.0';
    return tileset;
  }

  // Before the library counts the bytes.
  private prepare(scene: THREE.Object3D, tile: Tile): Promise<void> {
    scene.traverse((object) => {
      if (!(object instanceof THREE.Points)) return;
      const points = new TilePoints(object, levelOf(tile));
      this.ranges_ ??= points.ranges(this.origin);
      this.loaded_.set(tile, { points });
    });
    return Promise.resolve();
  }

  private show(scene: THREE.Object3D, tile: Tile): void {
    scene.traverse((object) => {
      // The library disposes of the tile's own material; ours is shared by all tiles.
      if (object instanceof THREE.Points) object.material = this.materials.of(levelOf(tile));
    });
    this.options_.onChange();
  }

  private isSeen(points: TilePoints, i: number): boolean {
    if (!this.kinds_.has(points.kind(i))) return false;
    if (this.clip_ === undefined) return true;
    const at = i * kPointWords;
    const { x, y, z } = this.group.position;
    const corner = add(points.corner, [x, y, z]);
    const place = (axis: 0 | 1 | 2): number => (points.floats[at + axis] as number) + corner[axis];
    const inside = contains(this.clip_.box, place(0), place(1), place(2));
    return inside === (this.clip_.mode === 'inside');
  }

  private alongRay(ray: Ray, tolerance: number): Loaded[] {
    const found: { loaded: Loaded; depth: number }[] = [];
    for (const tile of this.tiles_?.visibleTiles ?? []) {
      const loaded = this.loaded_.get(tile);
      if (loaded === undefined) continue;
      const { geometry, corner } = loaded.points;
      if (geometry.boundingSphere === null) geometry.computeBoundingSphere();
      const { center, radius } = geometry.boundingSphere as THREE.Sphere;
      const offset = subtract(add([center.x, center.y, center.z], corner), ray.origin);
      const depth = offset[0] * ray.direction[0] + offset[1] * ray.direction[1] + offset[2] * ray.direction[2];
      const beside = Math.sqrt(Math.max(Math.hypot(...offset) ** 2 - depth * depth, 0));
      if (depth + radius > 0 && beside <= radius + tolerance * (depth + radius)) found.push({ loaded, depth: depth - radius });
    }
    return found.sort((a, b) => a.depth - b.depth).map(({ loaded }) => loaded);
  }
}

// Boxes of our tilesets are axis-aligned: centre, and half the length of each axis.
function cornersOf(tile: Tile, origin: Vec3): Vec3[] {
  const box = (tile.boundingVolume as { box?: number[] }).box ?? [];
  const at = (axis: number, side: number): number =>
    (box[axis] ?? 0) + side * (box[3 + 4 * axis] ?? 0) + (origin[axis] as number);
  return [-1, 1].flatMap((x) => [-1, 1].flatMap((y) => [-1, 1].map((z): Vec3 => [at(0, x), at(1, y), at(2, z)])));
}
