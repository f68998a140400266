import * as THREE from 'three';
import { versionPath } from '../api/client.js';
import { send } from '../api/send.js';
import { listTiles } from '../api/tiles.js';
import type { Rgb } from '../scene/colour_maps.js';
import { shareHeights } from '../scene/height_range.js';
import { MapCloud } from '../scene/map_cloud.js';
import { rgbOf } from '../scene/painted_points.js';
import { cornerOf } from '../scene/point_layout.js';
import type { Scene } from '../scene/scene.js';
import type { MapBounds } from '../scene/scene_origin.js';
import type { Trouble } from '../scene/tile_source.js';
import { add, subtract, type Theme } from '../scene/types.js';
import type { Answer } from './answer.js';
import { lookOf, type Look, type Vehicle } from './fleet.js';
import { disposeMarks, pathLine, uncertaintyMarks, VehicleMark } from './marks.js';
import { MapPoints, tilesAround } from './residual.js';
import type { Pose, Vec3 } from './pose.js';
import { tileOf } from './routes.js';
import { ScanCloud } from './scan_cloud.js';
import type { ScanFile } from './scan_file.js';

/** The facts of a map that are needed to show scans in it. */
export interface ShownMap {
  name: string;
  version: string;
  origin: Vec3;
  voxel_size_m: number;
  tile_size_m: number;
  bounds?: MapBounds | undefined;
}

/** Scan points further from the sensor than this are not compared with the map [m]. */
const kResidualReach_m = 60;
const kTilesAtOnce = 4;
/** Share of grey in the map's colours while a scan is shown. */
const kMapTone = 0.82;
const kGrey: Record<Theme, number> = { dark: 0x59636f, light: 0xa9b1bb };

/** Colours of the marks, as in the style sheet; statuses have texts too. */
type MarkName = Look | 'prior' | 'scan' | 'near' | 'middle' | 'far' | 'free';
const kMarkColours: Record<Theme, Record<MarkName, number>> = {
  dark: {
    ok: 0x4fd67f, degraded: 0xffb347, lost: 0xff5d5d, stale: 0x8b949e, new: 0x9ecbff, prior: 0xffe45c,
    scan: 0x5ce1ff, near: 0x35e0a0, middle: 0xffd24a, far: 0xff4f7b, free: 0xff8adf,
  },
  light: {
    ok: 0x128a43, degraded: 0xb86a00, lost: 0xc81e1e, stale: 0x767f89, new: 0x1f6feb, prior: 0x8a5a00,
    scan: 0x0072b8, near: 0x008a5e, middle: 0xc28400, far: 0xd0124f, free: 0xa81e8c,
  },
};

/** A map with scans and vehicles in it. */
export class MapScene {
  readonly cloud: MapCloud;
  private readonly points = new MapPoints();
  private readonly fetched = new Map<string, Promise<void>>();
  private readonly stop = new AbortController();
  private readonly marks = new Map<string, VehicleMark>();
  private readonly priorMark: VehicleMark;
  private scan: ScanCloud | undefined;
  private painting = new AbortController();
  private uncertainty: THREE.Object3D | undefined;
  private path: THREE.Object3D | undefined;
  private poseMark: VehicleMark | undefined;

  constructor(
    private readonly scene: Scene,
    private readonly map: ShownMap,
    private theme: Theme,
    onTrouble: (trouble: Trouble | undefined) => void,
  ) {
    let known = false;
    this.cloud = new MapCloud({
      tilesetUrl: `${versionPath(map.name, map.version)}/3dtiles/tileset.json`,
      origin: map.origin, voxelSizeM: map.voxel_size_m, ask: (url, { signal }) => send('GET', url, { signal }),
      onChange: () => {
        known ||= shareHeights([this.cloud], scene.origin);
        scene.requestRender();
      },
      onTrouble,
    });
    scene.addCloud(this.cloud);
    this.priorMark = new VehicleMark(scene.origin as Vec3);
    this.priorMark.object.visible = false;
    scene.overlay.add(this.priorMark.object);
    this.setTheme(theme);
  }

  setTheme(theme: Theme): void {
    this.theme = theme;
    this.cloud.materials.setTheme(theme);
    this.tone();
  }

  /** Shows where the search starts; null removes it. */
  showPrior(pose: Pose | null): void {
    this.priorMark.object.visible = pose !== null;
    if (pose !== null) this.priorMark.show(pose, this.colour('prior'), 0.95);
    this.scene.requestRender();
  }

  /** Sets the scan, hidden until it has a pose. */
  setScan(scan: ScanFile | null): void {
    this.painting.abort();
    if (this.scan !== undefined) this.scene.removePoints(this.scan.object);
    this.scan?.dispose();
    this.scan = undefined;
    this.clearAnswer();
    if (scan !== null) {
      this.scan = new ScanCloud(scan.positions, this.scene.origin as Vec3, () => this.scene.requestRender());
      this.scan.paint(this.rgb('scan'));
      this.scene.addPoints(this.scan.object);
    }
    this.tone();
  }

  /** Shows the scan at a pose before it was localized, in one colour. */
  showScanAt(pose: Pose | null): void {
    this.scan?.place(pose);
  }

  /**
   * Moves the scan to the found pose, then colours it by its distance to the map.
   *
   * @param from pose where it starts. @param still without animation. @param byResidual coloured by distance.
   */
  async showAnswer(answer: Answer, from: Pose | null, still: boolean, byResidual: boolean): Promise<void> {
    this.clearAnswer();
    this.painting.abort();
    this.painting = new AbortController();
    const { signal } = this.painting;
    const { pose } = answer;
    if (this.scan === undefined || pose === null) {
      this.scan?.place(null);
      return;
    }
    this.scan.paint(this.rgb('scan'));
    await this.scan.snap(from ?? pose, pose, still);
    if (signal.aborted) return;
    this.markAnswer(answer, pose);
    if (byResidual) await this.paintResidual(pose, signal);
  }

  /** Colours the scan again: by its distance to the map, or in one colour. */
  async repaint(answer: Answer | null, byResidual: boolean): Promise<void> {
    this.painting.abort();
    this.painting = new AbortController();
    if (byResidual && answer?.pose) await this.paintResidual(answer.pose, this.painting.signal);
    else this.scan?.paint(this.rgb('scan'));
  }

  showPath(answers: readonly Answer[]): void {
    if (this.path !== undefined) disposeMarks(this.path);
    this.path = pathLine(answers.map((answer) => answer.pose), this.scene.origin as Vec3, this.colour('scan'));
    this.scene.overlay.add(this.path);
    this.scene.requestRender();
  }

  showVehicles(vehicles: readonly Vehicle[]): void {
    const seen = new Set<string>();
    for (const vehicle of vehicles) {
      if (vehicle.pose === null) continue;
      seen.add(vehicle.label);
      const look = lookOf(vehicle);
      this.markOf(vehicle.label).show(vehicle.pose, this.colour(look), look === 'stale' ? 0.55 : 1);
    }
    for (const [label, mark] of this.marks) {
      if (seen.has(label)) continue;
      mark.dispose();
      this.marks.delete(label);
    }
    this.scene.requestRender();
  }

  dispose(): void {
    this.stop.abort();
    this.setScan(null);
    for (const mark of [this.priorMark, ...this.marks.values()]) mark.dispose();
    if (this.path !== undefined) disposeMarks(this.path);
    this.scene.removeCloud(this.cloud);
    this.cloud.dispose();
  }

  private markOf(label: string): VehicleMark {
    let mark = this.marks.get(label);
    if (mark === undefined) {
      mark = new VehicleMark(this.scene.origin as Vec3);
      this.scene.overlay.add(mark.object);
      this.marks.set(label, mark);
    }
    return mark;
  }

  private clearAnswer(): void {
    if (this.uncertainty !== undefined) disposeMarks(this.uncertainty);
    this.poseMark?.dispose();
    this.uncertainty = this.poseMark = undefined;
    this.scene.requestRender();
  }

  private markAnswer(answer: Answer, pose: Pose): void {
    const colours = { ellipse: this.colour(answer.status), free: this.colour('free') };
    if (answer.covariance !== null) {
      this.uncertainty = uncertaintyMarks(pose, answer.covariance, answer.degenerate, this.scene.origin as Vec3, colours);
      this.scene.overlay.add(this.uncertainty);
    }
    this.poseMark = new VehicleMark(this.scene.origin as Vec3);
    this.poseMark.show(pose, this.colour(answer.status), 1);
    this.scene.overlay.add(this.poseMark.object);
    this.scene.requestRender();
  }

  private async paintResidual(pose: Pose, signal: AbortSignal): Promise<void> {
    const place = [pose.position[0] - this.map.origin[0], pose.position[1] - this.map.origin[1]] as const;
    const [x, y, reach] = [...place, kResidualReach_m];
    const listed = await listTiles({ map: this.map.name, version: this.map.version },
      { min: [x - reach, y - reach], max: [x + reach, y + reach] }, signal);
    const wanted = tilesAround(listed, place, reach, this.map.tile_size_m);
    const left = [...wanted];
    const next = async (): Promise<void> => {
      for (let tile = left.pop(); tile !== undefined && !signal.aborted; tile = left.pop()) await this.tile(tile.x, tile.y);
    };
    await Promise.all(Array.from({ length: kTilesAtOnce }, next));
    if (signal.aborted || this.scan === undefined) return;
    await this.scan.paintByResidual(this.points, {
      near: this.rgb('near'), middle: this.rgb('middle'), far: this.rgb('far'),
    }, signal);
  }

  private tile(x: number, y: number): Promise<void> {
    const name = `${x}/${y}`;
    let fetched = this.fetched.get(name);
    if (fetched === undefined) {
      // Relative to the picture's origin, as the scan.
      const from = add(cornerOf({ level: 0, x, y }), subtract(this.map.origin as Vec3, this.scene.origin));
      fetched = tileOf({ map: this.map.name, version: this.map.version }, x, y, this.stop.signal).then((positions) => this.points.add(positions, from));
      fetched.catch(() => this.fetched.delete(name));
      this.fetched.set(name, fetched);
    }
    return fetched;
  }

  private tone(): void {
    this.cloud.materials.setTone(kGrey[this.theme], this.scan === undefined ? 0 : kMapTone);
    this.scene.requestRender();
  }

  private colour(name: MarkName): THREE.Color {
    return new THREE.Color(kMarkColours[this.theme][name]);
  }

  private rgb(name: MarkName): Rgb {
    return rgbOf(kMarkColours[this.theme][name]);
  }
}
