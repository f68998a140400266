import { useRef } from 'preact/hooks';
import { key } from '../api/keys.js';
import { number } from '../ui/format.js';
import { Icon } from '../ui/icon.js';
import { Trouble } from '../ui/parts.js';
import { useStore } from '../state/store.js';
import { AnswerPanel } from './answer_panel.js';
import { DriveStrip } from './drive_strip.js';
import type { Localizer, LocalizeState } from './localizer.js';
import type { ShownMap } from './map_scene.js';
import { magnification } from './magnification.js';
import type { Pose } from './pose.js';
import { curlLine } from './request.js';
import type { MapPlace } from './routes.js';
import { kStartWords, StartChooser } from './start_chooser.js';
import { uncertaintyOf } from './uncertainty.js';

interface Props {
  localizer: Localizer;
  map: ShownMap;
  place: MapPlace;
  geodetic: boolean;
  poses: readonly Pose[];
  /** The next press on the map sets the prior. */
  onPoint: () => void;
  onLook: (pose: Pose | null | undefined) => void;
}

/** The scan, where to search for it, and the answer. */
export function ScanPanel({ localizer, map, geodetic, poses, onPoint, onLook }: Props) {
  const state = useStore(localizer.state);
  const answer = localizer.answer;
  return (
    <>
      <ScanChooser state={state} map={map} onFiles={(files) => void localizer.take(files)} onClear={() => void localizer.clear()} />
      <details class="where" open={answer === null || state.start !== 'everywhere'}>
        <summary>Search in: {kStartWords[state.start]}</summary>
        <StartChooser
          start={state.start} prior={state.prior} gnss={state.gnss} geodetic={geodetic}
          middle={poses[Math.floor(poses.length / 2)]?.position ?? map.origin}
          onStart={(kind) => {
            localizer.setStart(kind);
            if (kind === 'prior') onPoint();
          }}
          onPrior={(pose) => localizer.setPrior(pose, false)} onGnss={(text) => localizer.setGnss(text)}
        />
      </details>
      <div class="row">
        {state.drive === null && (
          <button type="button" class="primary" disabled={state.scan === null || state.busy !== null} onClick={() => void localizer.ask()}>
            {state.asked === null ? 'Find the scan' : 'Find it again'}
          </button>
        )}
        {state.start === 'prior' && <button type="button" onClick={onPoint}><Icon name="pin" /> Set the place</button>}
      </div>
      <p class="quiet status-line" role="status">{state.busy === 'reading' ? 'Reading the scan…' : state.busy === 'asking' ? 'Waiting for the server…' : ''}</p>
      {typeof state.error === 'string' && <div class="trouble" role="alert"><p>{state.error}</p></div>}
      {state.error !== null && typeof state.error !== 'string' && (
        <Trouble error={state.error} onRetry={() => void (state.drive === null ? localizer.ask() : state.drive.run.play())} />
      )}
      {state.drive !== null && (
        <>
          <DriveStrip
            run={state.drive.run} shown={state.shown} playing={state.playing} perSecond={state.perSecond}
            onShow={(index) => void localizer.show(index)} onPlaying={(playing) => localizer.setPlaying(playing)}
            onSpeed={(speed) => localizer.setSpeed(speed)}
          />
          <p class="quiet">Timestamps: {state.drive.stampSource}.</p>
        </>
      )}
      {answer !== null && (
        <>
          <AnswerPanel
            answer={answer} roundTrip_ms={state.drive === null ? (state.asked?.roundTrip_ms ?? null) : null} curl={curlOf(state)}
            magnified={answer.pose !== null && answer.covariance !== null ? magnification(uncertaintyOf(answer.pose, answer.covariance).major_m) : 1}
          />
          <div class="row">
            <button type="button" class="small" disabled={answer.pose === null} onClick={() => onLook(answer.pose)}><Icon name="eye" /> Move there</button>
          </div>
        </>
      )}
    </>
  );
}

function curlOf(state: LocalizeState): string | null {
  if (state.drive !== null || state.scan === null || state.asked === null) return null;
  const rewritten = /\.ply$/i.test(state.scan.name);
  return curlLine(window.location.origin, state.asked.path, state.scan, key.get() !== undefined, rewritten);
}

function ScanChooser({ state, map, onFiles, onClear }: {
  state: LocalizeState; map: ShownMap; onFiles: (files: File[]) => void; onClear: () => void;
}) {
  const one = useRef<HTMLInputElement>(null);
  const folder = useRef<HTMLInputElement>(null);
  const chosen = (input: HTMLInputElement): void => {
    const files = [...(input.files ?? [])];
    input.value = '';
    if (files.length > 0) onFiles(files);
  };
  return (
    <section class="scan-chooser" aria-label="Scan">
      <h1 class="title">Find a scan in {map.name}</h1>
      {state.scan === null && state.drive === null && (
        <p class="quiet">Drop a scan (KITTI .bin, PCD or PLY) or the folder of a drive anywhere on this page. It is sent to this server only.</p>
      )}
      {state.scan !== null && (
        <p class="scan-facts">
          <strong>{state.scan.name}</strong> {number(state.scan.positions.length / 3)} points
          {state.scan.dropped > 0 && <span class="quiet">, {number(state.scan.dropped)} without a return</span>}
        </p>
      )}
      <div class="row">
        <button type="button" onClick={() => one.current?.click()}><Icon name="upload" /> Choose a scan…</button>
        <button type="button" onClick={() => folder.current?.click()}>Choose a folder…</button>
        {(state.scan !== null || state.drive !== null) && <button type="button" class="plain" onClick={onClear}>Clear</button>}
      </div>
      <input
        ref={one} type="file" class="unseen" accept=".bin,.pcd,.ply" multiple tabIndex={-1} aria-label="Scan file"
        onChange={(event) => chosen(event.currentTarget)}
      />
      <input
        ref={folder} type="file" class="unseen" tabIndex={-1} aria-label="Folder of scans" {...{ webkitdirectory: true }}
        onChange={(event) => chosen(event.currentTarget)}
      />
    </section>
  );
}

/** Explains and chooses the colours of the scan in the picture. */
export function ScanLegend({ localizer }: { localizer: Localizer }) {
  const { scan, byResidual, painting } = useStore(localizer.state);
  if (scan === null) return null;
  return (
    <div class="stage-legend">
      <label class="inline">
        <input type="checkbox" checked={byResidual} onChange={(event) => localizer.setByResidual(event.currentTarget.checked)} />
        <span>Colour the scan by its distance to the map{byResidual && painting && <span class="quiet"> – computing…</span>}</span>
      </label>
      {byResidual && (
        <p class="residual-legend">
          <span>0 m</span><span class="ramp" role="img" aria-label="Colours from 0 to 0.5 m distance" /><span>0.5 m or more</span>
        </p>
      )}
    </div>
  );
}
