import type { ComponentChildren } from 'preact';
import { useEffect, useMemo, useState } from 'preact/hooks';
import { Scene } from '../scene/scene.js';
import { sceneOrigin } from '../scene/scene_origin.js';
import type { Trouble as TileTrouble } from '../scene/tile_source.js';
import { replaceQuery } from '../state/router.js';
import { SceneCanvas, StageTrouble } from '../ui/scene_canvas.js';
import { useStore } from '../state/store.js';
import { theme } from '../ui/theme.js';
import { filesOf } from './dropped.js';
import { watchFleet, type Vehicle } from './fleet.js';
import { FleetPanel } from './fleet_panel.js';
import { Localizer } from './localizer.js';
import { MapScene, type ShownMap } from './map_scene.js';
import type { Pose } from './pose.js';
import { priorTool } from './prior_tool.js';
import { vehicles as askVehicles, type MapPlace } from './routes.js';
import { ScanLegend, ScanPanel } from './scan_panel.js';
import { VehicleLabels } from './vehicle_labels.js';

interface Props {
  map: ShownMap;
  place: MapPlace;
  geodetic: boolean;
  poses: readonly Pose[];
  query: URLSearchParams;
}

/** Radius that is shown around a place [m]. */
const kLook_m = 16;
const kNoPoses: readonly Pose[] = [];

const wantsStill = (): boolean => window.matchMedia('(prefers-reduced-motion: reduce)').matches;

/** The picture of a map with its scans and vehicles, and the panel beside it. */
export function Workplace({ map, place, geodetic, poses = kNoPoses, query }: Props) {
  const localizer = useMemo(() => new Localizer(place, wantsStill), []);
  useEffect(() => () => localizer.dispose(), []);
  const origin = useMemo(() => sceneOrigin(map.origin, map.bounds), [map]);
  const [scene, setScene] = useState<Scene>();
  const [trouble, setTrouble] = useState<TileTrouble>();
  const mapScene = useMapScene(scene, map, poses, localizer, setTrouble);
  const [tab, setTab] = useTab(query);
  const fleet = useFleet(map.name);
  const [chosen, setChosen] = useState<string | null>(null);
  useEffect(() => mapScene?.showVehicles(fleet.vehicles), [fleet.vehicles, mapScene]);

  const lookAt = (pose: Pose | null | undefined): void => {
    if (pose) scene?.lookAtPlace(pose.position, kLook_m);
  };
  const choose = (label: string): void => {
    setChosen(label);
    lookAt(fleet.vehicles.find((vehicle) => vehicle.label === label)?.pose);
  };
  const point = (): void => scene?.setTool(priorTool(
    poses, (prior, final) => localizer.setPrior(prior, final), () => scene.setTool(null)));

  return (
    <DropTarget onFiles={(files) => { setTab('scan'); void localizer.take(files); }}>
      <div class="beside">
        <Tabs shown={tab} onShow={setTab} vehicles={fleet.vehicles.length} />
        <div class="beside-body" role="tabpanel" id="localize-panel" aria-labelledby={`tab-${tab}`} tabIndex={0}>
          {tab === 'scan'
            ? <ScanPanel localizer={localizer} map={map} place={place} geodetic={geodetic} poses={poses} onPoint={point} onLook={lookAt} />
            : (
              <>
                {fleet.fault !== null && <p class="trouble" role="alert">{fleet.fault}</p>}
                <FleetPanel vehicles={fleet.vehicles} chosen={chosen} onChoose={choose} />
              </>
            )}
        </div>
      </div>
      <div class="stage">
        <SceneCanvas
          origin={origin} onScene={setScene}
          label={`Map ${map.name}, version ${map.version}, in 3D. Arrow keys turn it, Shift with arrow keys moves it, plus and minus zoom, 0 shows all of it, T shows it from above.`}
        />
        <div class="stage-tools">
          <button type="button" onClick={() => scene?.showAll()}>Whole map</button>
          <button type="button" onClick={() => scene?.showFromAbove()}>From above</button>
        </div>
        <VehicleLabels scene={scene} vehicles={fleet.vehicles} />
        <ScanLegend localizer={localizer} />
        <StageTrouble text={trouble?.text} onRetry={() => mapScene?.cloud.retry()} />
      </div>
    </DropTarget>
  );
}

/** The map in the scene, connected with the localizer. */
function useMapScene(
  scene: Scene | undefined, map: ShownMap, poses: readonly Pose[], localizer: Localizer,
  onTrouble: (trouble: TileTrouble | undefined) => void,
): MapScene | undefined {
  const [mapScene, setMapScene] = useState<MapScene>();
  const colours = useStore(theme);
  useEffect(() => {
    if (scene === undefined) return undefined;
    const made = new MapScene(scene, map, theme.get(), onTrouble);
    setMapScene(made);
    scene.groundHeight = groundUnder(poses, map);
    const lookAt = (pose: Pose | null | undefined): void => {
      if (pose) scene.lookAtPlace(pose.position, kLook_m);
    };
    void made.cloud.ready.then(() => {
      scene.showAll();
      // A scan may have been found before the map could be framed.
      lookAt(localizer.answer?.pose);
    }, () => undefined);
    localizer.onFirstAnswer = lookAt;
    localizer.setScene(made);
    return () => {
      localizer.setScene(undefined);
      setMapScene(undefined);
      made.dispose();
    };
  }, [scene]);
  useEffect(() => mapScene?.setTheme(colours), [colours, mapScene]);
  return mapScene;
}

type Tab = 'scan' | 'vehicles';

/** The tab that is shown, kept in the address. */
function useTab(query: URLSearchParams): [Tab, (tab: Tab) => void] {
  const asked = query.get('show') === 'vehicles' ? 'vehicles' : 'scan';
  const [tab, setTab] = useState<Tab>(asked);
  // The address can change under the view: by a link, or by the browser's back button.
  useEffect(() => setTab(asked), [asked]);
  const show = (next: Tab): void => {
    setTab(next);
    replaceQuery(next === 'scan' ? {} : { show: next });
  };
  return [tab, show];
}

function Tabs({ shown, onShow, vehicles }: { shown: Tab; onShow: (tab: Tab) => void; vehicles: number }) {
  return (
    <div class="tabs" role="tablist" aria-label="Scan or vehicles">
      <TabButton name="scan" shown={shown} onShow={onShow}>Scan</TabButton>
      <TabButton name="vehicles" shown={shown} onShow={onShow}>
        Vehicles{vehicles > 0 && <span class="count">{vehicles}</span>}
      </TabButton>
    </div>
  );
}

function TabButton({ name, shown, onShow, children }: {
  name: Tab; shown: Tab; onShow: (name: Tab) => void; children: ComponentChildren;
}) {
  const other = name === 'scan' ? 'vehicles' : 'scan';
  return (
    <button
      type="button" role="tab" id={`tab-${name}`} aria-selected={shown === name} aria-controls="localize-panel" tabIndex={shown === name ? 0 : -1}
      onClick={() => onShow(name)}
      onKeyDown={(event) => {
        if (event.key !== 'ArrowRight' && event.key !== 'ArrowLeft') return;
        onShow(other);
        document.getElementById(`tab-${other}`)?.focus();
      }}
    >
      {children}
    </button>
  );
}

/** The whole view accepts dropped files, and says so while some are held over it. */
function DropTarget({ onFiles, children }: { onFiles: (files: File[]) => void; children: ComponentChildren }) {
  const [over, setOver] = useState(0);
  const carries = (event: DragEvent): boolean => [...(event.dataTransfer?.types ?? [])].includes('Files');
  return (
    <div
      class="localize beside-stage"
      onDragEnter={(event) => carries(event) && setOver((count) => count + 1)}
      onDragLeave={(event) => carries(event) && setOver((count) => Math.max(0, count - 1))}
      onDragOver={(event) => carries(event) && event.preventDefault()}
      onDrop={(event) => {
        if (!carries(event) || event.dataTransfer === null) return;
        event.preventDefault();
        setOver(0);
        void filesOf(event.dataTransfer).then(onFiles);
      }}
    >
      {children}
      {over > 0 && <div class="drop-over" aria-hidden="true"><p>Drop the scan to find it in this map</p></div>}
    </div>
  );
}

/** The sessions in a map, asked for again and again while the page is visible. */
function useFleet(map: string): { vehicles: Vehicle[]; fault: string | null } {
  const [state, setState] = useState<{ vehicles: Vehicle[]; fault: string | null }>({ vehicles: [], fault: null });
  useEffect(() => {
    const stop = new AbortController();
    const world = {
      ask: () => askVehicles(stop.signal),
      visible: () => document.visibilityState === 'visible',
      after: (ms: number, then: () => void) => {
        const timer = setTimeout(then, ms);
        return () => clearTimeout(timer);
      },
    };
    const watch = watchFleet(
      world, (all) => setState({ vehicles: all.filter((vehicle) => vehicle.map === map), fault: null }),
      (error) => setState((before) => ({ ...before, fault: error instanceof Error ? error.message : String(error) })));
    return () => {
      watch.stop();
      stop.abort();
    };
  }, [map]);
  return state;
}

/** Height of the ground [m] for presses where the map has no point: below the lowest recorded pose. */
function groundUnder(poses: readonly Pose[], map: ShownMap): number {
  const lowest = poses.reduce((least, pose) => Math.min(least, pose.position[2]), Infinity);
  return Number.isFinite(lowest) ? lowest - 1.8 : map.origin[2];
}
