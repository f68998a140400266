import * as THREE from 'three';

/** Limits of distance and angle of the eye; fields of OrbitControls. */
interface Limits {
  minDistance: number;
  maxDistance: number;
  maxPolarAngle: number;
}
type Move = (camera: THREE.Camera, target: THREE.Vector3, limits: Limits) => void;

const kTurn = (5 * Math.PI) / 180;
const kZoom = 1.15;
// Share of the distance to the target that one key press moves sideways.
const kStep = 0.06;

/** What a key press does to the view; undefined if the key has no meaning here. */
export function steer(event: KeyboardEvent): Move | 'all' | 'above' | undefined {
  if (event.ctrlKey || event.metaKey || event.altKey) return undefined;
  const act = event.shiftKey ? pan : turn;
  switch (event.key) {
    case 'ArrowLeft': return act(-1, 0);
    case 'ArrowRight': return act(1, 0);
    case 'ArrowUp': return act(0, 1);
    case 'ArrowDown': return act(0, -1);
    case '+': case '=': return zoom(1 / kZoom);
    case '-': case '_': return zoom(kZoom);
    case '0': case 'Home': return 'all';
    case 't': case 'T': return 'above';
    default: return undefined;
  }
}

function turn(right: number, up: number): Move {
  return orbit((spherical, limits) => {
    spherical.theta += right * kTurn;
    spherical.phi = THREE.MathUtils.clamp(spherical.phi - up * kTurn, 1e-3, limits.maxPolarAngle);
  });
}

function zoom(factor: number): Move {
  return orbit((spherical, limits) => {
    spherical.radius = THREE.MathUtils.clamp(spherical.radius * factor, limits.minDistance, limits.maxDistance);
  });
}

function orbit(change: (spherical: THREE.Spherical, limits: Limits) => void): Move {
  return (camera, target, limits) => {
    // THREE.Spherical has y up; the map has z up.
    const offset = camera.position.clone().sub(target);
    const spherical = new THREE.Spherical().setFromCartesianCoords(offset.y, offset.z, offset.x);
    change(spherical, limits);
    const turned = new THREE.Vector3().setFromSpherical(spherical);
    camera.position.set(target.x + turned.z, target.y + turned.x, target.z + turned.y);
  };
}

function pan(right: number, forward: number): Move {
  return (camera, target) => {
    const step = kStep * camera.position.distanceTo(target);
    const sideways = new THREE.Vector3().setFromMatrixColumn(camera.matrix, 0);
    const ahead = new THREE.Vector3(0, 0, 1).cross(sideways);
    const shift = sideways.multiplyScalar(right * step).add(ahead.multiplyScalar(forward * step));
    camera.position.add(shift);
    target.add(shift);
  };
}
