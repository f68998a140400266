import { useEffect, useRef } from 'preact/hooks';
import type { Scene } from '../scene/scene.js';
import type { Vehicle } from './fleet.js';

/** Names beside the marks of vehicles; for the eye only, since the list has them in words. */
export function VehicleLabels({ scene, vehicles }: { scene: Scene | undefined; vehicles: readonly Vehicle[] }) {
  const frame = useRef<HTMLDivElement>(null);
  const placed = vehicles.filter((vehicle) => vehicle.pose !== null);
  useEffect(() => {
    if (scene === undefined) return undefined;
    const move = (): void => placed.forEach((vehicle, i) => {
      const label = frame.current?.children[i] as HTMLElement | undefined;
      const at = scene.project(vehicle.pose!.position);
      if (label === undefined) return;
      label.style.visibility = at === null ? 'hidden' : 'visible';
      if (at !== null) label.style.transform = `translate(${at.x + 18}px, ${at.y}px) translateY(-50%)`;
    });
    move();
    return scene.onFrame(move);
  }, [scene, vehicles]);
  return (
    <div ref={frame} class="vehicle-labels" aria-hidden="true">
      {placed.map((vehicle) => <span key={vehicle.label}>{vehicle.label}</span>)}
    </div>
  );
}
