import { ApiError, isAborted, toApiError } from '../api/errors.js';
import { Store } from '../state/store.js';
import type { Answer } from './answer.js';
import { DriveRun } from './drive_run.js';
import { sortDropped } from './dropped.js';
import type { MapScene } from './map_scene.js';
import { poseWithHeading, headingOf, type Pose } from './pose.js';
import { readGnss, type GnssText } from './gnss_text.js';
import type { Start } from './request.js';
import { localize, sessionRoutes, type Asked, type MapPlace } from './routes.js';
import { checkSize, readScanFile, type ScanFile } from './scan_file.js';
import { ScanError } from './scan_points.js';
import { stampsOf } from './stamps.js';

/** A drive whose scans are sent to a session one after the other. */
export interface Drive {
  run: DriveRun;
  files: readonly File[];
  stampSource: string;
}

export interface LocalizeState {
  start: Start['kind'];
  prior: Pose | null;
  gnss: GnssText;
  scan: ScanFile | null;
  busy: 'reading' | 'asking' | null;
  /** The distances of the scan to the map are being computed. */
  painting: boolean;
  /** Why the last action failed: an error of the server or of a file. */
  error: ApiError | string | null;
  asked: Asked | null;
  drive: Drive | null;
  /** The scan of the drive that is shown. */
  shown: number;
  playing: boolean;
  perSecond: number;
  byResidual: boolean;
}

const kBegin: LocalizeState = {
  start: 'everywhere', prior: null, gnss: { latitude: '', longitude: '', altitude: '', sigma: '5' }, scan: null, busy: null, painting: false,
  error: null, asked: null, drive: null, shown: 0, playing: false, perSecond: 10, byResidual: true,
};

/** Where the animation of a scan starts that was searched for in the whole map: above the pose and turned. */
const kFromAbove_m = 30;
const kFromAside_rad = 0.5;

/** State and actions of the localization view; the picture follows it once there is one. */
export class Localizer {
  readonly state = new Store<LocalizeState>(kBegin);
  /** Called with the first pose that is found for a new scan. */
  onFirstAnswer: (pose: Pose) => void = () => undefined;
  private scene: MapScene | undefined;
  private asking = new AbortController();
  private timer: ReturnType<typeof setTimeout> | undefined;
  private answered = 0;
  private paintings = 0;

  /** @param still whether the person prefers less motion. */
  constructor(private readonly place: MapPlace, private readonly still: () => boolean) {}

  setScene(scene: MapScene | undefined): void {
    this.scene = scene;
    if (scene === undefined) return;
    const { scan, asked, prior, start } = this.state.get();
    scene.showPrior(start === 'prior' ? prior : null);
    scene.setScan(scan);
    if (asked !== null) void this.painted(scene.showAnswer(asked.answer, null, true, this.state.get().byResidual));
  }

  /** The answer for the scan in the picture. */
  get answer(): Answer | null {
    const { drive, shown, asked } = this.state.get();
    return drive === null ? (asked?.answer ?? null) : (drive.run.answers[shown] ?? null);
  }

  setStart(start: Start['kind']): void {
    this.change({ start });
    this.scene?.showPrior(start === 'prior' ? this.state.get().prior : null);
  }

  /** @param final false while it is still being dragged: the server is asked when it is true. */
  setPrior(prior: Pose, final: boolean): void {
    this.change({ prior, start: 'prior' });
    this.scene?.showPrior(prior);
    const { scan, drive } = this.state.get();
    if (final && scan !== null && drive === null) void this.ask();
  }

  setGnss(gnss: GnssText): void {
    this.change({ gnss });
  }

  setByResidual(byResidual: boolean): void {
    this.change({ byResidual });
    void this.painted(this.scene?.repaint(this.answer, byResidual));
  }

  /** Takes dropped or chosen files: one scan is localized alone, several go through a session. */
  async take(files: readonly File[]): Promise<void> {
    const { scans, times } = sortDropped(files);
    if (scans.length === 0) {
      const names = files.slice(0, 3).map((file) => file.name).join(', ');
      this.change({ error: `${names === '' ? 'There is no file' : `${names}: this is not a scan`}. Choose a .bin, .pcd or .ply file, or a folder of them.` });
      return;
    }
    await this.clear();
    if (scans.length === 1) await this.takeOne(scans[0]!);
    else await this.takeDrive(scans, times);
  }

  /** Asks where the scan was taken. */
  async ask(): Promise<void> {
    const { scan } = this.state.get();
    const start = this.start();
    if (typeof start === 'string') return this.change({ error: start });
    if (scan === null) return;
    this.asking.abort();
    this.asking = new AbortController();
    const { signal } = this.asking;
    this.change({ busy: 'asking', error: null });
    try {
      const asked = await localize(this.place, start, scan, signal);
      const { pose } = asked.answer;
      if (this.state.get().asked === null && pose !== null) this.onFirstAnswer(pose);
      this.change({ asked, busy: null });
      await this.painted(this.scene?.showAnswer(asked.answer, this.from(start, asked.answer), this.still(), this.state.get().byResidual));
    } catch (error) {
      if (!isAborted(error)) this.change({ error: toApiError(error), busy: null });
    }
  }

  /** Shows a scan of the drive. */
  async show(index: number): Promise<void> {
    const { drive, byResidual, playing } = this.state.get();
    const answer = drive?.run.answers[index];
    if (drive === null || answer === undefined) return;
    this.change({ shown: index });
    try {
      const scan = await this.read(drive.files[index]!);
      if (this.state.get().shown !== index || this.state.get().drive !== drive) return;
      this.change({ scan });
      this.scene?.setScan(scan);
      const moving = playing || drive.run.state === 'running';
      await this.painted(this.scene?.showAnswer(answer, null, true, byResidual && !moving));
    } catch (error) {
      this.fail(error);
    }
  }

  setPlaying(playing: boolean): void {
    clearTimeout(this.timer);
    const { drive, shown } = this.state.get();
    if (drive === null) return;
    this.change({ playing });
    const last = drive.run.answers.length - 1;
    if (!playing) void this.show(shown);
    else void this.play(shown >= last ? 0 : shown);
  }

  setSpeed(perSecond: number): void {
    this.change({ perSecond });
  }

  /** Stops the running requests and removes the scan from the picture. */
  async clear(): Promise<void> {
    this.asking.abort();
    clearTimeout(this.timer);
    const { drive } = this.state.get();
    this.change({ scan: null, asked: null, drive: null, shown: 0, playing: false, error: null, busy: null });
    this.scene?.setScan(null);
    this.scene?.showPath([]);
    await drive?.run.end();
  }

  dispose(): void {
    void this.clear();
  }

  private async takeOne(file: File): Promise<void> {
    this.change({ busy: 'reading' });
    try {
      const scan = await this.read(file);
      this.change({ scan, busy: null });
      this.scene?.setScan(scan);
      const { start, prior } = this.state.get();
      if (start === 'prior') this.scene?.showScanAt(prior);
      await this.ask();
    } catch (error) {
      this.fail(error);
    }
  }

  private async takeDrive(files: readonly File[], times: File | null): Promise<void> {
    const start = this.start();
    if (typeof start === 'string') return this.change({ error: start });
    const { stamps_ns, source } = stampsOf(files.length, (await times?.text()) ?? null);
    this.asking = new AbortController();
    const routes = sessionRoutes(this.place, start, (index) => this.read(files[index]!), stamps_ns, this.asking.signal);
    const run: DriveRun = new DriveRun(files.length, routes, () => this.driven(run));
    this.answered = 0;
    this.change({ drive: { run, files, stampSource: source } });
    await run.play();
  }

  private driven(run: DriveRun): void {
    const { drive, shown } = this.state.get();
    if (drive?.run !== run) return;
    const newest = run.answers.length - 1;
    const { error } = run;
    const shownError = error === undefined || isAborted(error) ? null : error instanceof ScanError ? error.message : toApiError(error);
    // A new object, so that the view is drawn again: the run itself stays the same.
    this.change({ drive: { ...drive }, error: shownError });
    this.scene?.showPath(run.answers);
    const pose = run.answers[newest]?.pose;
    if (newest === 0 && pose && this.answered === 0) this.onFirstAnswer(pose);
    this.answered = run.answers.length;
    if (newest >= 0 && (newest !== shown || run.state === 'done')) void this.show(newest);
  }

  private async play(index: number): Promise<void> {
    await this.show(index);
    const { drive, playing, perSecond } = this.state.get();
    if (!playing || drive === null) return;
    if (index >= drive.run.answers.length - 1) return this.setPlaying(false);
    this.timer = setTimeout(() => void this.play(index + 1), 1000 / perSecond);
  }

  private async read(file: File): Promise<ScanFile> {
    try {
      checkSize(file);
      return readScanFile(file.name, await file.arrayBuffer());
    } catch (error) {
      if (!(error instanceof DOMException)) throw error;
      throw new ApiError('garbled', `${file.name} can no longer be read: it was changed, moved or deleted. Choose it again.`);
    }
  }

  /** Where to search, or an error if that is incomplete. */
  private start(): Start | string {
    const { start, prior, gnss } = this.state.get();
    if (start === 'everywhere') return { kind: 'everywhere' };
    if (start === 'gnss') return readGnss(gnss);
    return prior === null ? 'Set a place first: press on the map where the sensor was, and drag in the direction it faced.' : { kind: 'prior', pose: prior };
  }

  private from(start: Start, { pose }: Answer): Pose | null {
    if (start.kind === 'prior' || pose === null) return start.kind === 'prior' ? start.pose : null;
    const [x, y, z] = pose.position;
    return poseWithHeading([x, y, z + kFromAbove_m], headingOf(pose) + kFromAside_rad);
  }

  /** Shows that distances are being computed until the latest computation ends. A failure only affects the colours. */
  private async painted(painting: Promise<void> | undefined): Promise<void> {
    const turn = ++this.paintings;
    this.change({ painting: true });
    await painting?.catch(() => undefined);
    if (turn === this.paintings) this.change({ painting: false });
  }

  private fail(error: unknown): void {
    if (isAborted(error)) return;
    this.change({ error: error instanceof ScanError ? error.message : toApiError(error), busy: null });
  }

  private change(part: Partial<LocalizeState>): void {
    this.state.set({ ...this.state.get(), ...part });
  }
}
