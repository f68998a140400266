import { versionPath } from '../api/client.js';
import { isAborted, toApiError } from '../api/errors.js';
import { onRecovery } from '../api/recovery.js';
import { send } from '../api/send.js';
import { replaceQuery } from '../state/router.js';
import type { Box } from '../scene/clip_box.js';
import { cut, type Clip } from '../scene/clip_planes.js';
import { GridLayer } from '../scene/grid_layer.js';
import { MapCloud, type Ranges } from '../scene/map_cloud.js';
import type { Decision } from '../scene/object_colours.js';
import { ObjectsLayer } from '../scene/objects_layer.js';
import type { Pick } from '../scene/pointers.js';
import { Scene } from '../scene/scene.js';
import { sceneOrigin } from '../scene/scene_origin.js';
import type { SeenObject } from '../scene/seen_objects.js';
import { SketchLayer } from '../scene/sketch_layer.js';
import type { Trouble } from '../scene/tile_source.js';
import { TrackLayer } from '../scene/track_layer.js';
import { depthAlong } from '../scene/pick.js';
import { subtract, type Theme } from '../scene/types.js';
import { writeViewState, type ViewState } from '../scene/view_state.js';
import { Store } from '../state/store.js';
import { Corrections, decide, decisionsOf } from './corrections.js';
import { loadSigns, type MapFacts, type MapSigns } from './facts.js';
import { GridView } from './grid_view.js';
import { optionsOf, type Options } from './options.js';
import { Tools } from './tools.js';

/** Numbers about drawing, for the panel. */
export interface Stats {
  readonly points: number;
  readonly tiles: number;
  readonly bytes: number;
  readonly pending: number;
  readonly frames: number;
  readonly scriptMs: number;
}

const kStatsEveryMs = 250;

/** State and actions of the viewer. The components read its stores and call its functions. */
export class ViewerModel {
  readonly scene: Scene;
  readonly cloud: MapCloud;
  readonly tools: Tools;
  readonly grid: GridView;
  readonly options: Store<Options>;
  readonly signs = new Store<MapSigns | undefined>(undefined);
  readonly ranges = new Store<Ranges | undefined>(undefined);
  readonly trouble = new Store<Trouble | undefined>(undefined);
  /** Why objects or the trajectory could not be loaded. */
  readonly fault = new Store<string | undefined>(undefined);
  readonly hover = new Store<Pick | undefined>(undefined);
  readonly chosen = new Store<SeenObject | undefined>(undefined);
  readonly decisions = new Store<ReadonlyMap<number, Decision>>(new Map());
  readonly stats = new Store<Stats | undefined>(undefined);
  readonly contextLost = new Store(false);
  private readonly objects_: ObjectsLayer;
  private readonly track_: TrackLayer;
  private readonly sketch_: SketchLayer;
  private readonly corrections_: Corrections;
  private readonly stop_ = new AbortController();
  private readonly endings_: (() => void)[] = [];
  private statsTimer_: ReturnType<typeof setTimeout> | undefined;

  /** @throws Error if the browser has no WebGL 2. */
  constructor(canvas: HTMLCanvasElement, readonly facts: MapFacts, state: ViewState, private theme_: Theme) {
    this.options = new Store(optionsOf(state));
    this.scene = new Scene(canvas, theme_, sceneOrigin(facts.origin, facts.bounds));
    const { origin } = this.scene;
    this.cloud = new MapCloud({
      tilesetUrl: `${versionPath(facts.name, facts.version)}/3dtiles/tileset.json`,
      origin: facts.origin, voxelSizeM: facts.voxel_size_m,
      ask: (url, { signal }) => send('GET', url, { signal }),
      onChange: () => this.scene.requestRender(), onTrouble: (trouble) => this.trouble.set(trouble),
    });
    this.scene.addCloud(this.cloud);
    this.objects_ = new ObjectsLayer(origin);
    this.track_ = new TrackLayer(origin);
    this.sketch_ = new SketchLayer(origin);
    this.corrections_ = new Corrections(facts.name);
    this.grid = new GridView(new GridLayer(origin), facts, this.stop_.signal, () => this.cutSigns());
    this.scene.overlay.add(
      this.objects_.group, this.track_.trajectory, this.track_.keyframes, this.track_.loops, this.sketch_.group, this.grid.group);
    this.tools = new Tools(this, this.sketch_, this.stop_.signal);
    this.listen(canvas);
    this.applyOptions();
    void this.begin(state);
  }

  get theme(): Theme {
    return this.theme_;
  }

  setTheme(theme: Theme): void {
    this.theme_ = theme;
    this.scene.setTheme(theme);
    this.showSigns();
    this.tools.redraw();
    this.applyOptions();
  }

  change(options: Partial<Options>): void {
    this.options.set({ ...this.options.get(), ...options });
    this.applyOptions();
    this.remember();
  }

  /** Shows the view of another address of the same map. */
  apply(state: ViewState): void {
    this.change({ ...optionsOf(state), budget: this.options.get().budget, quality: this.options.get().quality });
    if (state.eye !== undefined && state.target !== undefined) this.scene.setView({ eye: state.eye, target: state.target });
    else this.scene.showAll();
  }

  choose(object: SeenObject | undefined): void {
    this.chosen.set(object);
    this.objects_.choose(object);
    this.cutSigns();
  }

  /** Saves what the next rebuild does with an object; undefined removes the decision. @throws ApiError */
  async decide(object: SeenObject, decision: Decision | undefined): Promise<void> {
    await this.corrections_.change((edits) => decide(edits, object, decision));
    this.showSigns();
  }

  /** As `decide`, for everything in a box. @throws ApiError */
  async decideRegion(box: Box, action: Decision): Promise<void> {
    await this.corrections_.change((edits) => [...edits, { action, box }]);
  }

  /** Tries again after an error. */
  retry(): void {
    this.cloud.retry();
    if (this.fault.get() !== undefined) void this.loadSigns();
  }

  dispose(): void {
    this.stop_.abort();
    clearTimeout(this.statsTimer_);
    for (const end of this.endings_) end();
    this.cloud.dispose();
    this.scene.dispose();
  }

  private listen(canvas: HTMLCanvasElement): void {
    const { signal } = this.stop_;
    this.endings_.push(
      this.scene.onFrame(() => this.drawn()),
      this.scene.onView(() => this.remember()),
      this.scene.onHover((pick) => this.hover.set(pick)),
      onRecovery(() => this.fault.get() !== undefined && void this.loadSigns()));
    canvas.addEventListener('webglcontextlost', () => this.contextLost.set(true), { signal });
    canvas.addEventListener('webglcontextrestored', () => this.contextLost.set(false), { signal });
  }

  private async begin(state: ViewState): Promise<void> {
    void this.loadSigns();
    try {
      await this.cloud.ready;
    } catch {
      return;
    }
    this.scene.groundHeight ??= this.cloud.bounds?.min[2];
    this.scene.showAll();
    if (state.eye !== undefined && state.target !== undefined) this.scene.setView({ eye: state.eye, target: state.target });
  }

  private async loadSigns(): Promise<void> {
    try {
      const signs = await loadSigns(this.facts, this.stop_.signal);
      await this.corrections_.load(this.stop_.signal).catch((error: unknown) => {
        // If the server has no corrections or the key may not read them, the map is shown without them.
        if (isAborted(error)) throw error;
      });
      this.signs.set(signs);
      this.fault.set(undefined);
      this.showSigns();
    } catch (error) {
      if (!isAborted(error)) this.fault.set(toApiError(error).message);
    }
  }

  private showSigns(): void {
    const signs = this.signs.get();
    if (signs === undefined) return;
    this.decisions.set(decisionsOf(this.corrections_.edits, signs.objects));
    this.objects_.show(signs.objects, this.decisions.get(), this.theme_);
    this.objects_.choose(this.chosen.get());
    this.track_.show(signs.poses, signs.keyframes, signs.loops ?? [], this.theme_);
    const lowest = Math.min(...signs.poses.map(({ position }) => position[2]));
    // The ground below the sensor, for places without a point.
    if (Number.isFinite(lowest)) this.scene.groundHeight = lowest - 1.5;
    this.cutSigns();
  }

  /** The object under a place of the window, unless a point is in front of it. */
  objectAt(clientX: number, clientY: number): SeenObject | undefined {
    const ray = this.scene.ray(clientX, clientY);
    const met = this.objects_.pick(ray);
    if (met === undefined) return undefined;
    const pick = this.scene.pick(clientX, clientY);
    const depth = pick?.point === undefined ? Infinity : depthAlong(ray, subtract(pick.position, this.scene.origin));
    return depth < met.depth - 0.3 ? undefined : met.object;
  }

  private applyOptions(): void {
    const { colouring, kinds, overlays, grid, clip, eyeDome, quality, budget } = this.options.get();
    const { materials } = this.cloud;
    this.cloud.budget = budget;
    this.cloud.setKinds(new Set(kinds));
    materials.setTheme(this.theme_);
    materials.setColouring(colouring);
    materials.setRound(quality !== 'reduced');
    this.cloud.setClip(clip && this.inScene(clip));
    this.objects_.setClip(clip);
    this.objects_.group.visible = overlays.includes('objects');
    for (const overlay of ['trajectory', 'keyframes', 'loops'] as const) this.track_[overlay].visible = overlays.includes(overlay);
    this.grid.show(grid, this.theme_);
    this.tools.showClip(clip?.box);
    this.cutSigns();
    this.scene.setEyeDome(eyeDome);
    this.scene.setQuality(quality);
  }

  /** Clips boxes, lines and coloured ground like the points; to be called whenever they are made again. */
  private cutSigns(): void {
    const { clip } = this.options.get();
    const { trajectory, keyframes, loops } = this.track_;
    for (const group of [this.objects_.group, trajectory, keyframes, loops, this.grid.group]) cut(group, clip && this.inScene(clip));
    this.scene.requestRender();
  }

  private inScene({ box, mode }: Clip): Clip {
    const { x, y, z } = this.scene.toLocal(box.centre);
    return { box: { ...box, centre: [x, y, z] }, mode };
  }

  private drawn(): void {
    const { ranges } = this.cloud;
    if (ranges !== undefined && this.ranges.get() === undefined) {
      this.ranges.set(ranges);
      // The picture's coordinates are relative to its origin.
      const up = this.scene.origin[2];
      this.cloud.materials.setRange('height', { low: ranges.height.low - up, high: ranges.height.high - up });
      this.cloud.materials.setRange('intensity', ranges.intensity);
      this.cloud.materials.setRange('observations', ranges.observations);
      this.scene.requestRender();
    }
    this.statsTimer_ ??= setTimeout(() => {
      this.statsTimer_ = undefined;
      const { costs } = this.scene;
      this.stats.set({ ...this.cloud.stats, frames: costs.frames, scriptMs: costs.medianMs });
    }, kStatsEveryMs);
  }

  private remember(): void {
    if (this.cloud.bounds === undefined || this.stop_.signal.aborted) return;
    const { colouring, kinds, overlays, grid, clip } = this.options.get();
    const query = writeViewState({ ...this.scene.view, colouring, kinds, overlays, grid, ...(clip && { clip }) });
    replaceQuery(Object.fromEntries(query));
  }
}
