import './maps.css';
import type { ViewProps } from '../state/router.js';
import { MapPage } from './map_page.js';
import { MapsPage } from './maps_page.js';
import { RebuildPage } from './rebuild_page.js';

/** All maps; one map with its versions; the form that builds a new version. */
export default function MapsView({ path: [map, part] }: ViewProps) {
  if (map === undefined) return <MapsPage />;
  if (part === 'rebuild') return <RebuildPage map={map} />;
  return <MapPage key={map} name={map} />;
}
