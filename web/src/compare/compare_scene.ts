import * as THREE from 'three';
import { versionPath } from '../api/client.js';
import { send } from '../api/send.js';
import { shareHeights } from '../scene/height_range.js';
import { MapCloud } from '../scene/map_cloud.js';
import { PaintedPoints, rgbOf } from '../scene/painted_points.js';
import type { Scene } from '../scene/scene.js';
import type { Trouble } from '../scene/tile_source.js';
import { add, subtract, type Theme, type Vec3 } from '../scene/types.js';
import type { Layout } from './compare_state.js';
import type { Difference, Place, TileSide } from './difference.js';
import { differencePoints, type Version } from './routes.js';

/** Share of grey in the colours of both versions while their differences are shown. */
const kTone = 0.86;
const kColours: Record<Theme, { grey: number; onlyA: number; onlyB: number; place: number }> = {
  dark: { grey: 0x4a5460, onlyA: 0xff8a3d, onlyB: 0x2fd0ff, place: 0xffffff },
  light: { grey: 0xb3bac2, onlyA: 0xc24a00, onlyB: 0x0068b0, place: 0x18202a },
};
/** Most differing points that are drawn per side; those of the most changed tiles first. */
const kMostPoints = 2_000_000;
const kTilesAtOnce = 4;
/** Points drawn of each version. */
const kBudget = 1_500_000;

/** Two versions of a map in one picture. */
export class CompareScene {
  readonly a: MapCloud;
  readonly b: MapCloud;
  private readonly stop = new AbortController();
  private loading = new AbortController();
  private highlights: { points: PaintedPoints; side: 'onlyA' | 'onlyB' }[] = [];
  private place: THREE.Object3D | undefined;
  private theme: Theme;
  private toned = false;

  constructor(private readonly scene: Scene, map: string, private readonly versions: { a: Version; b: Version }, theme: Theme, onTrouble: (trouble: Trouble | undefined) => void) {
    this.theme = theme;
    let known = false;
    const cloudOf = (version: Version): MapCloud => new MapCloud({
      tilesetUrl: `${versionPath(map, version.name)}/3dtiles/tileset.json`,
      origin: version.origin, voxelSizeM: version.voxel_size_m, ask: (url, { signal }) => send('GET', url, { signal }), onTrouble,
      onChange: () => {
        known ||= shareHeights([this.a, this.b], scene.origin);
        scene.requestRender();
      },
    });
    this.a = cloudOf(versions.a);
    this.b = cloudOf(versions.b);
    for (const cloud of [this.a, this.b]) {
      cloud.budget = kBudget;
      scene.addCloud(cloud);
    }
    this.setTheme(theme);
  }

  setTheme(theme: Theme): void {
    this.theme = theme;
    for (const cloud of [this.a, this.b]) cloud.materials.setTheme(theme);
    for (const { points, side } of this.highlights) this.paint(points, side);
    this.setTone(this.toned);
  }

  setLayout(layout: Layout, split: number): void {
    this.scene.setSplit({ left: [this.a], right: [this.b], share: split, apart: layout === 'side' });
  }

  /**
   * Highlights the differences, or nothing.
   *
   * @return how many of the differing points are drawn; fewer than all if there are too many.
   */
  async showDifference(difference: Difference | null): Promise<number> {
    this.loading.abort();
    this.loading = new AbortController();
    this.clear();
    this.setTone(difference !== null);
    if (difference === null) return 0;
    const sides = [
      this.load(difference, 'only_in_other', 'onlyA', this.loading.signal),
      this.load(difference, 'only_in_version', 'onlyB', this.loading.signal),
    ];
    return (await Promise.all(sides)).reduce((sum, points) => sum + points, 0);
  }

  /** Draws a frame around a place; null removes it. */
  markPlace(place: Place | null, origin: Vec3): void {
    this.place?.removeFromParent();
    this.place = undefined;
    if (place !== null) {
      const corner = (values: Vec3): THREE.Vector3 => this.scene.toLocal([0, 1, 2].map((i) => values[i]! + origin[i]!) as unknown as Vec3);
      const box = new THREE.Box3(corner(place.min), corner(place.max)).expandByScalar(0.5);
      const frame = new THREE.Box3Helper(box, new THREE.Color(kColours[this.theme].place));
      this.place = frame;
      this.scene.overlay.add(frame);
    }
    this.scene.requestRender();
  }

  retry(): void {
    this.a.retry();
    this.b.retry();
  }

  dispose(): void {
    this.stop.abort();
    this.loading.abort();
    this.clear();
    this.place?.removeFromParent();
    this.scene.setSplit(undefined);
    for (const cloud of [this.a, this.b]) {
      this.scene.removeCloud(cloud);
      cloud.dispose();
    }
  }

  private async load(difference: Difference, key: 'only_in_version' | 'only_in_other', side: 'onlyA' | 'onlyB', signal: AbortSignal): Promise<number> {
    const tiles = difference.tiles.flatMap((tile) => tile[key] ?? []).sort((x, y) => y.area_m2 - x.area_m2);
    let drawn = 0;
    const next = async (): Promise<void> => {
      for (let tile = tiles.shift(); tile !== undefined && !signal.aborted; tile = tiles.shift()) {
        if (drawn + tile.points > kMostPoints) continue;
        drawn += tile.points;
        await this.add(tile, side, difference.origin, signal);
      }
    };
    await Promise.all(Array.from({ length: kTilesAtOnce }, next));
    return drawn;
  }

  private async add(tile: TileSide, side: 'onlyA' | 'onlyB', origin: Vec3, signal: AbortSignal): Promise<void> {
    const { positions, corner } = await differencePoints(tile.url, signal);
    if (signal.aborted) return;
    const cloud = side === 'onlyA' ? this.a : this.b;
    const points = new PaintedPoints({
      positions, sizeM: 1.4 * this.versions.b.voxel_size_m, pixels: [2.2, 16], towardsEyeM: 1.5 * this.versions.b.voxel_size_m,
    });
    // As a child of the version's points, so that both are shown on the same side.
    points.object.position.set(...add(corner, subtract(origin, cloud.origin)));
    this.paint(points, side);
    cloud.group.add(points.object);
    points.object.updateMatrixWorld();
    this.highlights.push({ points, side });
    this.scene.requestRender();
  }

  private paint(points: PaintedPoints, side: 'onlyA' | 'onlyB'): void {
    const colour = rgbOf(kColours[this.theme][side]);
    points.paint(() => colour);
    points.shown();
  }

  private setTone(toned: boolean): void {
    this.toned = toned;
    for (const cloud of [this.a, this.b]) cloud.materials.setTone(kColours[this.theme].grey, toned ? kTone : 0);
    this.scene.requestRender();
  }

  private clear(): void {
    for (const { points } of this.highlights) points.dispose();
    this.highlights = [];
    this.scene.requestRender();
  }
}
