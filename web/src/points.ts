import * as THREE from 'three';
import { heightRamp, type Theme } from './colour.js';
import type { Layer } from './tile.js';

const kRampSteps = 256;

const kVertexShader = `
  uniform float sizeM, pixelsPerRadian, minPixels, maxPixels, low, high;
  varying float share;
  void main() {
    vec4 seen = modelViewMatrix * vec4(position, 1.0);
    gl_Position = projectionMatrix * seen;
    gl_PointSize = clamp(sizeM * pixelsPerRadian / -seen.z, minPixels, maxPixels);
    share = (position.z - low) / (high - low);
  }`;

// The ramp is sRGB already and goes out as it is.
const kFragmentShader = `
  uniform sampler2D ramp;
  uniform vec3 tone;
  uniform float toned;
  varying float share;
  void main() {
    vec3 colour = texture2D(ramp, vec2(clamp(share, 0.0, 1.0), 0.5)).rgb;
    gl_FragColor = vec4(mix(colour, tone, toned), 1.0);
  }`;

/** How each layer is set apart: a colour that the height colour is mixed with, and how much. */
const kTones: Record<Theme, Record<Layer, { tone: [number, number, number]; toned: number }>> = {
  dark: {
    measured: { tone: [0, 0, 0], toned: 0 },
    ground: { tone: [0.27, 0.3, 0.35], toned: 0.62 },
    projected: { tone: [1, 0.48, 0.78], toned: 1 },
  },
  light: {
    measured: { tone: [0, 0, 0], toned: 0 },
    ground: { tone: [0.68, 0.71, 0.75], toned: 0.66 },
    projected: { tone: [0.78, 0.08, 0.5], toned: 1 },
  },
};

/** The materials of the three layers of points; they share the height range and the size. */
export class PointMaterials {
  readonly byLayer: Record<Layer, THREE.ShaderMaterial>;
  private readonly ramp_ = { value: new THREE.DataTexture(new Uint8Array(4 * kRampSteps), kRampSteps, 1) };
  private readonly shared_ = {
    ramp: this.ramp_,
    low: { value: 0 },
    high: { value: 1 },
    sizeM: { value: 0.1 },
    pixelsPerRadian: { value: 1 },
    minPixels: { value: 1 },
    maxPixels: { value: 1 },
  };

  constructor(theme: Theme) {
    const make = (): THREE.ShaderMaterial =>
      new THREE.ShaderMaterial({
        uniforms: { ...this.shared_, tone: { value: new THREE.Vector3() }, toned: { value: 0 } },
        vertexShader: kVertexShader,
        fragmentShader: kFragmentShader,
      });
    this.byLayer = { measured: make(), ground: make(), projected: make() };
    this.ramp_.value.magFilter = this.ramp_.value.minFilter = THREE.LinearFilter;
    this.setTheme(theme);
  }

  setTheme(theme: Theme): void {
    this.ramp_.value.image.data = heightRamp(kRampSteps, theme);
    this.ramp_.value.needsUpdate = true;
    for (const [layer, material] of Object.entries(this.byLayer)) {
      const { tone, toned } = kTones[theme][layer as Layer];
      (material.uniforms['tone']!.value as THREE.Vector3).set(...tone);
      material.uniforms['toned']!.value = toned;
    }
  }

  /** Heights [m, relative to the map's origin] of the first and the last colour. */
  setHeightRange(low: number, high: number): void {
    this.shared_.low.value = low;
    this.shared_.high.value = high;
  }

  /** A point covers its voxel, but stays visible from afar and small from near by. */
  setSize(voxelSizeM: number, pixelsPerRadian: number, pixelRatio: number): void {
    this.shared_.sizeM.value = voxelSizeM;
    this.shared_.pixelsPerRadian.value = pixelsPerRadian;
    this.shared_.minPixels.value = 1.25 * pixelRatio;
    this.shared_.maxPixels.value = 5 * pixelRatio;
  }
}
