import * as THREE from 'three';
import { ramp, type RampName } from './colour_maps.js';
import type { Cells } from './grid_map.js';
import { empty } from './lines.js';
import { subtract, type Range, type Theme, type Vec3 } from './types.js';

const kSteps = 256;
/** Height above the ground [m], so that its points do not hide the layer. */
const kLift = 0.35;

// Clipped by three.js's own pieces of shader.
const kVertexShader = `
  #include <clipping_planes_pars_vertex>
  varying vec3 tint;
  void main() {
    tint = color;
    vec4 mvPosition = modelViewMatrix * vec4(position, 1.0);
    gl_Position = projectionMatrix * mvPosition;
    #include <clipping_planes_vertex>
  }`;
const kFragmentShader = `
  #include <clipping_planes_pars_fragment>
  varying vec3 tint;
  void main() {
    #include <clipping_planes_fragment>
    gl_FragColor = vec4(tint, 0.62);
  }`;

/** Cells of the ground, coloured by a value. */
export class GridLayer {
  readonly group = new THREE.Group();

  /** @param origin of the scene, map coordinates [m]. */
  constructor(private readonly origin_: Vec3) {}

  /** @param gridOrigin what the cells are relative to, map coordinates [m]. */
  show(cells: Cells, gridOrigin: Vec3, range: Range, name: RampName, theme: Theme): void {
    this.clear();
    const colours = ramp(name, kSteps, theme);
    const shift = subtract(gridOrigin, this.origin_);
    const positions = new Float32Array(12 * cells.count);
    const vertexColours = new Uint8Array(12 * cells.count);
    const indices = new Uint32Array(6 * cells.count);
    for (let i = 0; i < cells.count; ++i) {
      const share = Math.min(Math.max(((cells.value[i] as number) - range.low) / (range.high - range.low), 0), 1);
      const colour = colours.subarray(4 * Math.round(share * (kSteps - 1)));
      [[0, 0], [1, 0], [1, 1], [0, 1]].forEach(([dx, dy], corner) => {
        const at = 12 * i + 3 * corner;
        positions[at] = (cells.x[i] as number) + (dx as number) * cells.cellM + shift[0];
        positions[at + 1] = (cells.y[i] as number) + (dy as number) * cells.cellM + shift[1];
        positions[at + 2] = (cells.height[i] as number) + shift[2] + kLift;
        vertexColours.set(colour.subarray(0, 3), at);
      });
      indices.set([0, 1, 2, 0, 2, 3].map((corner) => 4 * i + corner), 6 * i);
    }
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(positions, 3));
    geometry.setAttribute('color', new THREE.BufferAttribute(vertexColours, 3, true));
    geometry.setIndex(new THREE.BufferAttribute(indices, 1));
    this.group.add(new THREE.Mesh(geometry, material()));
  }

  clear(): void {
    empty(this.group);
  }
}

// The colours are sRGB already, so they are not converted.
function material(): THREE.ShaderMaterial {
  return new THREE.ShaderMaterial({
    transparent: true, depthWrite: false, side: THREE.DoubleSide, vertexColors: true, clipping: true,
    vertexShader: kVertexShader, fragmentShader: kFragmentShader,
  });
}
