import { versionPath } from '../api/client.js';
import { isAborted, toApiError } from '../api/errors.js';
import { send } from '../api/send.js';
import { listTiles } from '../api/tiles.js';
import { boxOverDiagonal, contains, type Box, type ClipMode } from '../scene/clip_box.js';
import { exportPoints, type ExportFormat } from '../scene/export_points.js';
import { coordinateOf, select, type Points } from '../scene/point_layout.js';
import type { PointerPlace, Tool } from '../scene/pointers.js';
import { areaOf, fetchRegion, kRegionLimit, tilesOf } from '../scene/region.js';
import { boxOf, extentOf, lengthOf, profileOf, type Profile, type Section } from '../scene/section.js';
import type { SketchLayer } from '../scene/sketch_layer.js';
import { kKinds, subtract, type Kind, type Vec3 } from '../scene/types.js';
import { Store } from '../state/store.js';
import { ClipGrip } from './clip_grip.js';
import type { ViewerModel } from './model.js';

export type ToolName = 'look' | 'measure' | 'section' | 'clip';
/** What can be exported. */
export type ExportScope = 'map' | 'clip' | 'section';

/** The state of a long operation. */
export type Work =
  | { readonly state: 'none' }
  | { readonly state: 'busy'; readonly share: number }
  | { readonly state: 'failed'; readonly text: string };

const kSectionWidthM = 1;
const kClipBelowM = 1;
const kClipAboveM = 8;

/** The tools in the picture: look, measure, section, clip, export. */
export class Tools {
  readonly name = new Store<ToolName>('look');
  /** Points of the measured line; map coordinates. */
  readonly line = new Store<readonly Vec3[]>([]);
  readonly section = new Store<Section | undefined>(undefined);
  readonly profile = new Store<Profile | undefined>(undefined);
  readonly work = new Store<Work>({ state: 'none' });
  private readonly grip_: ClipGrip;
  private pending_: Vec3[] = [];
  private cutting_: AbortController | undefined;

  constructor(
    private readonly model_: ViewerModel,
    private readonly sketch_: SketchLayer,
    private readonly signal_: AbortSignal,
  ) {
    this.grip_ = new ClipGrip(model_.scene, (box) => this.setClip(box, model_.options.get().clip?.mode));
    signal_.addEventListener('abort', () => this.cutting_?.abort());
    this.use('look');
  }

  /** Chooses a tool; unfinished work of the one before is dropped. */
  use(name: ToolName): void {
    this.name.set(name);
    this.pending_ = [];
    this.model_.scene.setTool(this.toolOf(name));
    this.redraw();
  }

  /** Clicks the middle of the picture, for the keyboard. */
  placeInTheMiddle(): void {
    const { left, top, width, height } = this.model_.scene.canvas.getBoundingClientRect();
    const [clientX, clientY] = [left + width / 2, top + height / 2];
    const pick = () => this.model_.scene.pick(clientX, clientY);
    this.click({ clientX, clientY, shiftKey: false, pick });
  }

  /** Removes the last point. */
  undo(): void {
    if (this.name.get() === 'measure') this.line.set(this.line.get().slice(0, -1));
    this.pending_ = this.pending_.slice(0, -1);
    this.redraw();
  }

  clear(): void {
    this.line.set([]);
    this.section.set(undefined);
    this.profile.set(undefined);
    this.pending_ = [];
    this.redraw();
  }

  setSectionWidth(width: number): void {
    const section = this.section.get();
    if (section !== undefined && width > 0) void this.cut(section.from, section.to, width);
  }

  /** Draws the clip box with its handles; without a clip box, the outline of the section. */
  showClip(box: Box | undefined): void {
    const section = this.section.get();
    this.sketch_.setBox(box ?? (section && boxOf(section)), box !== undefined, this.model_.theme);
  }

  redraw(): void {
    this.sketch_.setLine(this.pending_.length > 0 ? this.pending_ : this.line.get(), this.model_.theme);
    this.showClip(this.model_.options.get().clip?.box);
    this.model_.scene.requestRender();
  }

  /** Points in full resolution as a file. */
  async export(scope: ExportScope, format: ExportFormat): Promise<{ blob: Blob; points: number } | undefined> {
    try {
      const tiles = await this.points(scope, this.signal_);
      const blob = exportPoints(tiles, this.model_.facts.origin, format);
      this.work.set({ state: 'none' });
      return { blob, points: tiles.reduce((sum, { count }) => sum + count, 0) };
    } catch (error) {
      if (!isAborted(error)) this.work.set({ state: 'failed', text: toApiError(error).message });
      return undefined;
    }
  }

  private toolOf(name: ToolName): Tool {
    if (name === 'look') {
      const box = (): Box | undefined => this.model_.options.get().clip?.box;
      return {
        down: (place) => this.grip_.take(box(), place),
        move: (place) => this.grip_.move(box(), place),
        up: () => this.grip_.release(),
        cancel: () => this.grip_.cancel(),
        click: (place) => this.model_.choose(this.model_.objectAt(place.clientX, place.clientY)),
        doubleClick: (place) => this.comeNearer(place.pick()?.position),
      };
    }
    return {
      cursor: 'crosshair',
      click: (place) => this.click(place),
      move: (place) => this.preview(place),
      cancel: () => {
        if (this.name.get() === name) this.use('look');
      },
    };
  }

  // Moves half way to a place, and rotates around it from then on.
  private comeNearer(place: Vec3 | undefined): void {
    if (place === undefined) return;
    const { eye } = this.model_.scene.view;
    const middle = [0, 1, 2].map((axis) => ((eye[axis] as number) + (place[axis] as number)) / 2) as unknown as Vec3;
    this.model_.scene.flyTo({ eye: middle, target: place });
  }

  private click(place: PointerPlace): void {
    const at = place.pick()?.position;
    if (at === undefined) return;
    const name = this.name.get();
    if (name === 'look') this.model_.choose(this.model_.objectAt(place.clientX, place.clientY));
    if (name === 'measure') this.line.set([...this.line.get(), at]);
    if (name === 'section' || name === 'clip') this.corner(name, at);
    this.redraw();
  }

  private corner(name: 'section' | 'clip', at: Vec3): void {
    const [first] = this.pending_;
    if (first === undefined) {
      this.pending_ = [at];
      return;
    }
    this.pending_ = [];
    if (name === 'clip') {
      this.setClip(boxOverDiagonal(first, at, kClipBelowM, kClipAboveM));
    } else {
      void this.cut(first, at, kSectionWidthM);
    }
    this.use('look');
  }

  private setClip(box: Box, mode: ClipMode = 'inside'): void {
    this.model_.change({ clip: { box, mode } });
  }

  // Shows the result of a click here.
  private preview(place: PointerPlace): void {
    const name = this.name.get();
    const before = name === 'measure' ? this.line.get() : this.pending_;
    if (before.length === 0) return;
    const at = place.pick()?.position;
    if (at === undefined) return;
    const first = before[0] as Vec3;
    if (name === 'clip') this.sketch_.setBox(boxOverDiagonal(first, at, kClipBelowM, kClipAboveM), false, this.model_.theme);
    this.sketch_.setLine(name === 'clip' ? [first] : [...before, at], this.model_.theme);
    this.model_.scene.requestRender();
  }

  private async cut(from: Vec3, to: Vec3, width: number): Promise<void> {
    const bounds = this.model_.cloud.bounds;
    const section: Section = { from, to, width, low: bounds?.min[2] ?? -1000, high: bounds?.max[2] ?? 1000 };
    if (!(lengthOf(section) > 0)) return;
    this.cutting_?.abort();
    this.cutting_ = new AbortController();
    const { signal } = this.cutting_;
    try {
      const tiles = await this.fetch(boxOf(section), signal);
      const profile = this.profileIn(section, tiles);
      // Sets the height to that of the points found, so that the outline fits them.
      const [low, high] = extentOf(profile) ?? [from[2], from[2] + 1];
      this.section.set({ ...section, low, high });
      this.profile.set(profile);
      this.work.set({ state: 'none' });
      this.redraw();
    } catch (error) {
      if (!isAborted(error) && !signal.aborted) this.work.set({ state: 'failed', text: toApiError(error).message });
    }
  }

  // Corners of tiles are relative to the map's origin.
  private profileIn(section: Section, tiles: readonly Points[]): Profile {
    const up = this.model_.facts.origin[2];
    const profile = profileOf({
      ...section, from: this.inMap(section.from), to: this.inMap(section.to), low: section.low - up, high: section.high - up,
    }, tiles, () => true);
    return { ...profile, heights: profile.heights.map((height) => height + up) };
  }

  private async points(scope: ExportScope, signal: AbortSignal): Promise<Points[]> {
    const { kinds, clip } = this.model_.options.get();
    const section = this.section.get();
    const box = scope === 'clip' ? clip?.box : scope === 'section' ? section && boxOf(section) : undefined;
    const outside = scope === 'clip' && clip?.mode === 'outside';
    const tiles = await this.fetch(outside ? undefined : box, signal);
    const shown = kKinds.map((kind: Kind) => kinds.includes(kind));
    const own = box && { ...box, centre: this.inMap(box.centre) };
    return tiles.map((tile) => select(tile, (i) => shown[tile.kinds[i] as number] === true && (own === undefined ||
      contains(own, coordinateOf(tile, i, 0), coordinateOf(tile, i, 1), coordinateOf(tile, i, 2)) !== outside)));
  }

  private async fetch(box: Box | undefined, signal: AbortSignal): Promise<Points[]> {
    const { facts } = this.model_;
    const own = box && { ...box, centre: this.inMap(box.centre) };
    const path = versionPath(facts.name, facts.version);
    this.work.set({ state: 'busy', share: 0 });
    const listed = await listTiles({ map: facts.name, version: facts.version }, own && areaOf(own), signal, kRegionLimit);
    const tiles = tilesOf(listed, own);
    return fetchRegion(
      tiles,
      async ({ level, x, y }) => (await send('GET', `${path}/tiles/${level}/${x}/${y}`, { signal, timeoutS: 120 })).arrayBuffer(),
      (done, of) => this.work.set({ state: 'busy', share: done / of }));
  }

  private inMap(place: Vec3): Vec3 {
    return subtract(place, this.model_.facts.origin);
  }
}
